#include "storage/sqlite_gain_tables.h"

#include <array>
#include <map>
#include <optional>

#include "absl/strings/str_cat.h"
#include "core/library/scenario_digest.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

// In the order of the columns that EntryIn reads; the gains begin at kFirstGain.
constexpr std::string_view kEntryColumns = "scenario, id, kind, k1, k2, k3, k4, k5, x1, x2, x3, x4, x5, x6";
constexpr int kFirstGain = 3;
constexpr int kFirstError = kFirstGain + kGainCount;
constexpr int kEntryEnd = kFirstError + 6;

absl::Status GainSetNotFound(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no gain set ", FormatReceived(id)));
}

absl::Status InGainSet(const std::string& id, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat("gain set ", id, ": ", status.message()));
}

absl::StatusOr<std::int64_t> ScenarioKey(Connection& connection, const GainSet& set) {
  auto statement = connection.Prepare("SELECT key FROM gain_scenarios WHERE digest = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(set.scenario_digest).Step();
  if (!row.ok()) return row.status();
  if (*row) return statement->Int(0);
  absl::Status status = connection.Run("INSERT INTO gain_scenarios (digest, definition) VALUES (?, ?)",
                                       set.scenario_digest, ToJson(LibraryDefinition(set.scenario)));
  if (!status.ok()) return status;
  return connection.last_insert_key();
}

absl::StatusOr<LibraryEntry> EntryIn(const Statement& row) {
  LibraryEntry entry{.id = row.Text(1)};
  for (int column = kFirstGain; column < kEntryEnd; ++column) {
    if (!row.IsNumberOrNull(column)) return InGainSet(entry.id, absl::DataLossError("a text for a number"));
  }
  const std::int64_t kind = row.Int(2);
  if (kind < 0 || kind > static_cast<int>(GainSetKind::kImported)) {
    return InGainSet(entry.id, absl::DataLossError(absl::StrCat("the unknown kind ", kind)));
  }
  entry.kind = static_cast<GainSetKind>(kind);
  for (int i = 0; i < kGainCount; ++i) entry.gains[static_cast<std::size_t>(i)] = row.Real(kFirstGain + i);
  const auto x = [&row](int i) { return row.Real(kFirstError + i); };
  if (!row.IsNull(kFirstError)) entry.initial_error = ErrorState{x(0), x(1), x(2), x(3), x(4), x(5)};
  return entry;
}

// The definitions of scenarios, each read once.
class Definitions {
 public:
  struct Definition {
    std::string digest;
    Scenario scenario;
  };

  explicit Definitions(Connection& connection) : connection_(connection) {}

  absl::StatusOr<const Definition*> Get(std::int64_t key) {
    if (const auto known = by_key_.find(key); known != by_key_.end()) return &known->second;
    auto statement = connection_.Prepare("SELECT digest, definition FROM gain_scenarios WHERE key = ?");
    if (!statement.ok()) return statement.status();
    const absl::StatusOr<bool> row = statement->Bind(key).Step();
    if (!row.ok()) return row.status();
    if (!*row) return absl::DataLossError(absl::StrCat("the scenario ", key, " of a gain set is missing"));
    absl::StatusOr<Scenario> scenario = ScenarioFromJson(statement->Text(1));
    if (!scenario.ok()) return scenario.status();
    return &by_key_.emplace(key, Definition{statement->Text(0), *std::move(scenario)}).first->second;
  }

 private:
  Connection& connection_;
  std::map<std::int64_t, Definition> by_key_;
};

// Columns behind kEntryColumns.
constexpr std::string_view kSetColumns = "create_time_us, scenario_id, job_id, campaign_id, document";

absl::StatusOr<GainSet> GainSetIn(const Statement& row, Definitions& definitions) {
  absl::StatusOr<LibraryEntry> entry = EntryIn(row);
  if (!entry.ok()) return entry.status();
  GainSet set;
  if (absl::Status status = ReadGainSetDocument(row.Text(kEntryEnd + 4), set); !status.ok()) {
    return InGainSet(entry->id, status);
  }
  const auto definition = definitions.Get(row.Int(0));
  if (!definition.ok()) return InGainSet(entry->id, definition.status());
  set.id = std::move(entry->id);
  set.kind = entry->kind;
  set.gains = entry->gains;
  set.initial_error = entry->initial_error;
  set.create_time_us = row.Int(kEntryEnd);
  set.scenario = (*definition)->scenario;
  set.scenario.id = row.Text(kEntryEnd + 1);
  set.scenario_digest = (*definition)->digest;
  set.job_id = row.Text(kEntryEnd + 2);
  set.campaign_id = row.Text(kEntryEnd + 3);
  return set;
}

absl::StatusOr<std::vector<GainSet>> ReadRows(Connection& connection, std::string_view tail,
                                              const std::vector<Statement::Value>& values) {
  auto statement = connection.PrepareOnce(
      absl::StrCat("SELECT ", ToAbsl(kEntryColumns), ", ", ToAbsl(kSetColumns),
                   " FROM gain_sets JOIN gain_documents ON gain_documents.gain_set = gain_sets.key", ToAbsl(tail)));
  if (!statement.ok()) return statement.status();
  Definitions definitions(connection);
  std::vector<GainSet> sets;
  absl::Status status = statement->BindAll(values).ForEachRow([&] {
    absl::StatusOr<GainSet> set = GainSetIn(*statement, definitions);
    if (set.ok()) sets.push_back(*std::move(set));
    return set.status();
  });
  if (!status.ok()) return status;
  return sets;
}

class Where {
 public:
  template <typename T>
  void AddAnyOf(std::string_view column, const std::vector<T>& wanted) {
    if (wanted.empty()) return;
    std::string places;
    for (const T& value : wanted) {
      absl::StrAppend(&places, places.empty() ? "?" : ", ?");
      if constexpr (std::is_enum_v<T>) {
        values_.emplace_back(static_cast<std::int64_t>(value));
      } else {
        values_.emplace_back(value);
      }
    }
    Add(absl::StrCat(ToAbsl(column), " IN (", places, ")"));
  }
  void AddBefore(const GainSetQuery::Cursor& cursor) {
    Add("(create_time_us, id) < (?, ?)");
    values_.emplace_back(cursor.create_time_us);
    values_.emplace_back(cursor.id);
  }
  void AddLimit(std::int64_t limit) { values_.emplace_back(limit); }

  const std::string& text() const { return text_; }
  const std::vector<Statement::Value>& values() const { return values_; }

 private:
  void Add(const std::string& condition) { absl::StrAppend(&text_, text_.empty() ? " WHERE " : " AND ", condition); }

  std::string text_;
  std::vector<Statement::Value> values_;
};

}  // namespace

absl::Status InsertGainSet(Connection& connection, const GainSet& set) {
  const absl::StatusOr<std::int64_t> scenario = ScenarioKey(connection, set);
  if (!scenario.ok()) return scenario.status();
  const Gains& k = set.gains;
  std::array<std::optional<double>, 6> x;
  if (const auto& e = set.initial_error) x = {e->x1, e->x2, e->x3, e->x4, e->x5, e->x6};
  absl::Status status = connection.Run(
      "INSERT INTO gain_sets (scenario, id, kind, k1, k2, k3, k4, k5, x1, x2, x3, x4, x5, x6, create_time_us, "
      "scenario_id, job_id, campaign_id) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
      *scenario, set.id, static_cast<int>(set.kind), k[0], k[1], k[2], k[3], k[4], x[0], x[1], x[2], x[3], x[4], x[5],
      set.create_time_us, set.scenario.id, set.job_id, set.campaign_id);
  if (!status.ok()) return status;
  return connection.Run("INSERT INTO gain_documents (gain_set, document) VALUES (?, ?)", connection.last_insert_key(),
                        GainSetDocument(set));
}

absl::Status RemoveGainSet(Connection& connection, const std::string& id) {
  // The document goes with it.
  absl::Status status = connection.Run("DELETE FROM gain_sets WHERE id = ?", id);
  if (status.ok() && connection.rows_changed() == 0) return GainSetNotFound(id);
  return status;
}

absl::StatusOr<GainSet> ReadGainSet(Connection& connection, const std::string& id) {
  auto sets = ReadRows(connection, " WHERE id = ?", {id});
  if (!sets.ok()) return sets.status();
  if (sets->empty()) return GainSetNotFound(id);
  return std::move(sets->front());
}

absl::StatusOr<std::vector<GainSet>> ReadGainSets(Connection& connection, const GainSetQuery& query) {
  Where where;
  where.AddAnyOf("kind", query.kinds);
  where.AddAnyOf("scenario_id", query.scenario_ids);
  where.AddAnyOf("job_id", query.job_ids);
  where.AddAnyOf("campaign_id", query.campaign_ids);
  if (query.after) where.AddBefore(*query.after);
  where.AddLimit(query.limit);
  return ReadRows(connection, absl::StrCat(where.text(), " ORDER BY create_time_us DESC, id DESC LIMIT ?"),
                  where.values());
}

absl::Status ReadGainLibrary(Connection& connection, const GainStore::Shelf& shelf) {
  auto statement = connection.Prepare(absl::StrCat("SELECT ", ToAbsl(kEntryColumns), " FROM gain_sets ORDER BY key"));
  if (!statement.ok()) return statement.status();
  std::map<std::int64_t, std::vector<LibraryEntry>> by_scenario;
  absl::Status status = statement->ForEachRow([&] {
    absl::StatusOr<LibraryEntry> entry = EntryIn(*statement);
    if (entry.ok()) by_scenario[statement->Int(0)].push_back(*std::move(entry));
    return entry.status();
  });
  if (!status.ok()) return status;
  Definitions definitions(connection);
  for (const auto& [key, entries] : by_scenario) {
    const auto definition = definitions.Get(key);
    if (!definition.ok()) return definition.status();
    shelf((*definition)->digest, (*definition)->scenario, entries);
  }
  return absl::OkStatus();
}

}  // namespace orbitune
