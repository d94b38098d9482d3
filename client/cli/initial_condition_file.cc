#include "client/cli/initial_condition_file.h"

#include <algorithm>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/campaign_csv.h"
#include "client/cli/files.h"
#include "client/cli/initial_condition.h"

namespace orbitune::cli {
namespace {

struct Column {
  std::string name;
  bool element = false;
  bool role = false;
};

bool IsElement(const std::string& name) {
  const auto& state = *v1::OrbitState::descriptor();
  for (int i = 0; i < state.field_count(); ++i) {
    if (state.field(i)->message_type()->FindFieldByName(name) != nullptr) return true;
  }
  return false;
}

std::vector<std::string> Cells(absl::string_view line) {
  std::vector<std::string> cells = absl::StrSplit(line, ',');
  for (std::string& cell : cells) absl::StripAsciiWhitespace(&cell);
  return cells;
}

absl::StatusOr<std::vector<Column>> ReadHeader(absl::string_view line) {
  std::vector<Column> columns;
  for (std::string& name : Cells(line)) {
    Column column{.name = std::move(name)};
    column.element = IsElement(column.name);
    column.role = column.name == "role";
    if (!column.element && !IsCampaignCsvColumn(column.name)) {
      return absl::InvalidArgumentError(
          absl::StrCat("line 1: '", column.name, "' is not the name of an element (see `orbitune --help`)"));
    }
    columns.push_back(std::move(column));
  }
  return columns;
}

// Nothing for a row that is no tuned initial condition's.
absl::StatusOr<v1::OrbitState> ReadRow(const std::vector<Column>& columns, const std::vector<std::string>& cells) {
  if (cells.size() != columns.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat(cells.size(), " values where the header has ", columns.size(), " columns"));
  }
  std::vector<std::string> pairs;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (columns[i].role && cells[i] != "tuned") return v1::OrbitState();
    if (columns[i].element && !cells[i].empty()) pairs.push_back(absl::StrCat(columns[i].name, "=", cells[i]));
  }
  if (pairs.empty()) return absl::InvalidArgumentError("no elements");
  return ParseInitialCondition(absl::StrJoin(pairs, ","));
}

}  // namespace

absl::StatusOr<v1::InitialConditions> ParseInitialConditionsCsv(const std::string& text) {
  v1::InitialConditions conditions;
  absl::StatusOr<std::vector<Column>> columns;
  bool header = true;
  for (int number = 1; absl::string_view line : absl::StrSplit(absl::StripPrefix(text, "\xef\xbb\xbf"), '\n')) {
    line = absl::StripTrailingAsciiWhitespace(line);
    if (header) {
      columns = ReadHeader(line);
      if (!columns.ok()) return columns.status();
      header = false;
    } else if (!line.empty()) {
      const auto state = ReadRow(*columns, Cells(line));
      if (!state.ok()) return absl::InvalidArgumentError(absl::StrCat("line ", number, ": ", state.status().message()));
      if (state->form_case() != v1::OrbitState::FORM_NOT_SET) *conditions.add_list() = *state;
    }
    ++number;
  }
  if (conditions.list().empty()) return absl::InvalidArgumentError("no initial conditions");
  return conditions;
}

absl::StatusOr<v1::InitialConditions> ReadInitialConditions(const std::string& path) {
  const absl::StatusOr<std::string> text = ReadTextFile(path);
  if (!text.ok()) return text.status();
  if (absl::EndsWithIgnoreCase(path, ".csv")) {
    auto conditions = ParseInitialConditionsCsv(*text);
    if (conditions.ok()) return conditions;
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", conditions.status().message()));
  }
  const bool array = absl::StartsWith(absl::StripLeadingAsciiWhitespace(*text), "[");
  v1::InitialConditions conditions;
  absl::Status status = ParseJson(array ? absl::StrCat("{\"list\":", *text, "}") : *text, path, &conditions);
  if (status.ok() && conditions.list().empty() && !conditions.has_draw()) {
    status = absl::InvalidArgumentError(absl::StrCat(path, ": no initial conditions"));
  }
  if (!status.ok()) return status;
  return conditions;
}

}  // namespace orbitune::cli
