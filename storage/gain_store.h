// Where gain sets are kept: the library's memory. Those of jobs come with the job's change to kSucceeded
// (JobStore::ChangeState), all others through here; deleting a job leaves its gain set where it is.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/library/gain_library.h"
#include "core/library/gain_set.h"

namespace orbitune {

// "TUNED", "ROBUST", "MEAN", "IMPORTED".
std::string_view NameOf(GainSetKind kind);
// DATA_LOSS for any other text.
absl::StatusOr<GainSetKind> GainSetKindOf(std::string_view name);

// Gain sets come newest first, those of one time by descending id; a page begins behind the last one of the page
// before.
struct GainSetQuery {
  // Each: any of; empty: every one.
  std::vector<GainSetKind> kinds;
  std::vector<std::string> scenario_ids;
  std::vector<std::string> job_ids;
  std::vector<std::string> campaign_ids;
  int limit = 50;  // > 0
  struct Cursor {
    std::int64_t create_time_us = 0;
    std::string id;
  };
  std::optional<Cursor> after;
};

// Thread-safe. Writes and reads, their callbacks and errors are as JobStore's (job_store.h).
class GainStore {
 public:
  using Done = std::function<void(absl::Status)>;
  // The gain sets of one scenario digest, in the order they were stored; definition: as LibraryDefinition leaves it.
  using Shelf = std::function<void(const std::string& digest, const Scenario& definition,
                                   const std::vector<LibraryEntry>& entries)>;

  GainStore() = default;
  GainStore(const GainStore&) = delete;
  GainStore& operator=(const GainStore&) = delete;
  virtual ~GainStore() = default;

  // All or none. Their ids are unused so far.
  virtual void AddGainSets(std::vector<GainSet> sets, Done done) = 0;

  virtual void DeleteGainSet(const std::string& id, Done done) = 0;

  // NOT_FOUND if there is none.
  virtual absl::StatusOr<GainSet> GetGainSet(const std::string& id) const = 0;

  virtual absl::StatusOr<std::vector<GainSet>> ListGainSets(const GainSetQuery& query) const = 0;

  // Every gain set, as the library keeps it: one call for each digest.
  virtual absl::Status ReadLibrary(const Shelf& shelf) const = 0;
};

}  // namespace orbitune
