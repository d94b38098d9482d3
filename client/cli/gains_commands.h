// The seam between the command line and `orbitune gains ...`: what each may be told.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/commands.h"

namespace orbitune::cli {

struct GainsQueryOptions {
  FlightOptions flight;
  std::int32_t max_candidates = 0;
  std::int32_t max_answers = 0;
  std::int64_t refine_ms = 0;  // 0: no refinement
};
// Exit code 1 where nothing settles.
int RunGainsQuery(Session& session, const GainsQueryOptions& options);

// Which gain sets: one by name, or those of a filter.
struct GainsListOptions {
  std::string name;
  std::string filter;
  std::string scenario;
  std::string kind;
  std::int64_t limit = 0;  // 0: all
};
int RunGainsList(Session& session, const GainsListOptions& options);
int RunGainsShow(Session& session, const std::string& name);

struct GainsExportOptions {
  GainsListOptions which;
  std::string format = "csv";  // csv, json, c-header
  std::string output;          // empty: stdout
};
int RunGainsExport(Session& session, const GainsExportOptions& options);

struct GainsImportOptions {
  std::string file;
  std::string scenario_file;  // the definition, for rows of a scenario that the server does not know
  bool validate_only = false;
};
int RunGainsImport(Session& session, const GainsImportOptions& options);

int RunGainsDelete(Session& session, const std::vector<std::string>& names);

}  // namespace orbitune::cli
