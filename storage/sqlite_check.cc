#include "storage/sqlite_check.h"

#include <array>
#include <condition_variable>
#include <mutex>
#include <string_view>
#include <thread>

#include "absl/strings/str_cat.h"
#include "storage/sqlite_schema.h"

namespace orbitune {
namespace {

constexpr int kMostFaults = 20;  // of a kind

// Each gives a row with a sentence per fault. A seq is a state change's or an iteration's; iterations are dense from 1.
constexpr std::array<std::string_view, 7> kConsistency{
    R"sql(SELECT printf('jobs/%s: %d iterations are recorded, %d are there, the last is %d', id, iterations, n, last)
          FROM (SELECT id, iterations, count(i.job) AS n, coalesce(max(i.iteration), 0) AS last
                FROM jobs LEFT JOIN iterations i ON i.job = jobs.key WHERE iterations_removed_us IS NULL GROUP BY key)
          WHERE n <> iterations OR last <> iterations)sql",
    R"sql(SELECT printf('jobs/%s: the last event is %d, but %d iterations and %d state changes are recorded', id,
                        last_seq, iterations, state_changes)
          FROM jobs WHERE last_seq <> iterations + state_changes)sql",
    R"sql(SELECT printf('jobs/%s: %d state changes are recorded, %d are there', id, state_changes, n)
          FROM (SELECT id, state_changes, (SELECT count(*) FROM job_events WHERE job = key) AS n FROM jobs)
          WHERE n <> state_changes)sql",
    R"sql(SELECT printf('jobs/%s: its inputs are missing, or no JSON', id)
          FROM jobs LEFT JOIN job_documents ON job = key WHERE NOT coalesce(json_valid(spec), 0))sql",
    R"sql(SELECT printf('campaigns/%s: the last event is %d, but %d are there', id, last_seq, n)
          FROM (SELECT id, last_seq, (SELECT count(*) FROM campaign_events WHERE campaign = id) AS n FROM campaigns)
          WHERE n <> last_seq)sql",
    R"sql(SELECT printf('gainSets/%s: its document is missing, or no JSON', id)
          FROM gain_sets LEFT JOIN gain_documents ON gain_set = key WHERE NOT coalesce(json_valid(document), 0))sql",
    R"sql(SELECT printf('%d iterations belong to no job (key %d)', count(*), job) FROM iterations GROUP BY job
          HAVING job NOT IN (SELECT key FROM jobs) AND job NOT IN (SELECT job FROM deleted_jobs))sql"};

absl::Status AddRows(Connection& connection, std::string_view sql, std::vector<std::string>& rows) {
  auto statement = connection.PrepareOnce(absl::StrCat(ToAbsl(sql), " LIMIT ", kMostFaults));
  if (!statement.ok()) return statement.status();
  return statement->ForEachRow([&] {
    rows.push_back(statement->Text(0));
    return absl::OkStatus();
  });
}

absl::StatusOr<std::vector<std::string>> RowsOf(Connection& connection, const std::string& sql) {
  std::vector<std::string> rows;
  auto statement = connection.PrepareOnce(sql);
  if (!statement.ok()) return statement.status();
  absl::Status status = statement->ForEachRow([&] {
    rows.push_back(statement->Text(0));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  return rows;
}

// Interrupts a connection once the time is over.
class Alarm {
 public:
  Alarm(Connection& connection, std::chrono::milliseconds limit)
      : thread_([this, &connection, limit] {
          std::unique_lock lock(mutex_);
          while (!off_.wait_for(lock, rang_ ? kAgain : limit, [this] { return is_off_; })) {
            rang_ = true;
            connection.Interrupt();  // again and again: one between two statements would be lost
          }
        }) {}
  ~Alarm() {
    {
      const std::lock_guard lock(mutex_);
      is_off_ = true;
    }
    off_.notify_all();
    thread_.join();
  }
  bool rang() {
    const std::lock_guard lock(mutex_);
    return rang_;
  }

 private:
  static constexpr std::chrono::milliseconds kAgain{5};
  std::mutex mutex_;
  std::condition_variable off_;
  bool is_off_ = false;
  bool rang_ = false;
  std::thread thread_;
};

absl::StatusOr<std::int64_t> CountOf(Connection& connection, const std::string& table, const std::string& where = "") {
  const auto there = connection.QueryInt(absl::StrCat("SELECT count(*) FROM sqlite_schema WHERE name = '", table, "'"));
  if (!there.ok() || *there == 0) return there;
  return connection.QueryInt(absl::StrCat("SELECT count(*) FROM ", table, where));
}

std::string Megabytes(std::int64_t bytes) {
  return bytes < 10'000'000 ? absl::StrCat(bytes / 1000, " kB") : absl::StrCat(bytes / 1'000'000, " MB");
}

}  // namespace

std::string ToString(const DatabaseSummary& s) {
  return absl::StrCat("schema version ", s.schema_version, ", ", s.jobs, " jobs (", s.unfinished_jobs, " unfinished), ",
                      s.iterations, " iterations, ", s.campaigns, " campaigns, ", s.gain_sets, " gain sets, ",
                      Megabytes(s.bytes));
}

absl::StatusOr<DatabaseSummary> Summarise(Connection& connection) {
  DatabaseSummary summary;
  const auto read = [&](absl::StatusOr<std::int64_t> value, std::int64_t& out) {
    if (value.ok()) out = *value;
    return value.status();
  };
  absl::Status status = read(connection.QueryInt("PRAGMA user_version"), summary.schema_version);
  if (status.ok()) {
    status = read(connection.QueryInt("SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"),
                  summary.bytes);
  }
  if (status.ok()) status = read(CountOf(connection, "jobs"), summary.jobs);
  if (status.ok()) {
    status =
        read(CountOf(connection, "jobs", " WHERE state IN ('QUEUED', 'RUNNING', 'PAUSED')"), summary.unfinished_jobs);
  }
  if (status.ok()) status = read(CountOf(connection, "iterations"), summary.iterations);
  if (status.ok()) status = read(CountOf(connection, "campaigns"), summary.campaigns);
  if (status.ok()) status = read(CountOf(connection, "gain_sets"), summary.gain_sets);
  if (!status.ok()) return status;
  return summary;
}

absl::StatusOr<std::vector<std::string>> FindFaults(Connection& connection) {
  auto faults = RowsOf(connection, absl::StrCat("PRAGMA integrity_check(", kMostFaults, ")"));
  if (!faults.ok()) return faults.status();
  if (faults->size() == 1 && faults->front() == "ok") faults->clear();
  absl::Status status = AddRows(connection,
                                "SELECT printf('a row of %s refers to one of %s that is not there', \"table\", parent) "
                                "FROM pragma_foreign_key_check",
                                *faults);
  const auto version = connection.QueryInt("PRAGMA user_version");
  if (!version.ok()) return version.status();
  if (*version == static_cast<std::int64_t>(Migrations().size())) {
    for (const std::string_view sql : kConsistency) {
      if (status.ok()) status = AddRows(connection, sql, *faults);
    }
  }
  if (!status.ok()) return status;
  return faults;
}

absl::StatusOr<bool> QuickCheck(Connection& connection, std::chrono::milliseconds limit) {
  const auto tables = RowsOf(connection,
                             "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%' "
                             "ORDER BY name = 'iterations', name");
  if (!tables.ok()) return tables.status();
  std::optional<Alarm> alarm;
  if (limit > std::chrono::milliseconds(0)) alarm.emplace(connection, limit);
  for (const std::string& table : *tables) {
    const auto rows = RowsOf(connection, absl::StrCat("PRAGMA quick_check(", table, ")"));
    if (alarm && alarm->rang()) return false;  // whatever it found: it was cut short
    if (!rows.ok()) return rows.status();
    if (rows->size() != 1 || rows->front() != "ok") {
      return absl::DataLossError(
          absl::StrCat(connection.path(), ": ", rows->empty() ? "its check gave no answer" : rows->front()));
    }
  }
  return true;
}

}  // namespace orbitune
