#include "storage/sqlite_job_queries.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_provenance.h"

namespace orbitune {
namespace {

// What is needed of a job to read its history.
struct JobProgress {
  std::int64_t key = 0;
  std::int64_t last_seq = 0;
  std::int64_t iterations = 0;
  TimeUs iterations_removed_us = 0;
};

// A job as its own row and document have it; the iterations are still to be read.
struct JobRow {
  JobProgress progress;
  std::optional<std::int64_t> best_iteration;
  JobRecord record;
};

std::string SelectJobs(std::string_view report, std::string_view tail) {
  return absl::StrCat(
      "SELECT jobs.key, id, state, create_time_us, start_time_us, end_time_us, update_time_us, last_seq, "
      "state_changes, iterations, best_iteration, error_message, spec, ",
      ToAbsl(report),
      ", doubles, provenance, digest, iterations_removed_us FROM jobs JOIN job_documents ON job_documents.job = "
      "jobs.key LEFT JOIN "
      "checkpoints ON checkpoints.job "
      "= "
      "jobs.key",
      ToAbsl(tail));
}

absl::Status InJob(const std::string& id, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat("job ", id, ": ", status.message()));
}

absl::StatusOr<JobRow> JobRowIn(const Statement& row) {
  JobRow job;
  job.progress = {.key = row.Int(0), .last_seq = row.Int(7), .iterations = row.Int(9)};
  if (!row.IsNull(10)) job.best_iteration = row.Int(10);
  JobRecord& record = job.record;
  record.id = row.Text(1);
  const absl::StatusOr<JobState> state = JobStateOf(row.Text(2));
  if (!state.ok()) return InJob(record.id, state.status());
  record.state = *state;
  record.create_time_us = row.Int(3);
  record.start_time_us = row.Int(4);
  record.end_time_us = row.Int(5);
  record.update_time_us = row.Int(6);
  record.last_seq = row.Int(7);
  record.state_changes = row.Int(8);
  record.error_message = row.Text(11);
  absl::StatusOr<JobSpec> spec = JobSpecFromJson(row.Text(12));
  if (!spec.ok()) return InJob(record.id, spec.status());
  record.spec = *std::move(spec);
  if (!row.IsNull(13)) {
    absl::StatusOr<JobReport> report = JobReportFromJson(row.Text(13));
    if (!report.ok()) return InJob(record.id, report.status());
    record.report = *std::move(report);
  }
  record.checkpoint = row.Doubles(14);
  if (!row.IsNull(15)) {
    absl::StatusOr<Provenance> provenance = ReadProvenance(row.Text(15), row.Text(16));
    if (!provenance.ok()) return InJob(record.id, provenance.status());
    record.provenance = *std::move(provenance);
  }
  record.iterations_removed_us = row.Int(17);
  return job;
}

absl::StatusOr<std::vector<JobRow>> ReadJobRows(Statement& statement) {
  std::vector<JobRow> rows;
  absl::Status status = statement.ForEachRow([&] {
    absl::StatusOr<JobRow> row = JobRowIn(statement);
    if (row.ok()) rows.push_back(*std::move(row));
    return row.status();
  });
  if (!status.ok()) return status;
  return rows;
}

absl::Status MissingIteration(const std::string& id, std::int64_t iteration) {
  return absl::DataLossError(absl::StrCat("job ", id, ": iteration ", iteration, " is missing from its history"));
}

absl::Status ReadOneIteration(Connection& connection, const JobRow& row, std::int64_t iteration,
                              std::optional<IterationRecord>& record) {
  auto found = ReadIterations(connection, row.progress.key, iteration, 1);
  if (!found.ok()) return found.status();
  if (found->empty() || found->front().iteration != iteration) return MissingIteration(row.record.id, iteration);
  record = found->front();
  return absl::OkStatus();
}

absl::StatusOr<JobRecord> WithIterations(Connection& connection, JobRow row) {
  JobRecord& record = row.record;
  if (row.progress.iterations > 0) {
    if (absl::Status s = ReadOneIteration(connection, row, 1, record.first); !s.ok()) return s;
    if (absl::Status s = ReadOneIteration(connection, row, row.progress.iterations, record.latest); !s.ok()) return s;
  }
  if (row.best_iteration) {
    if (absl::Status s = ReadOneIteration(connection, row, *row.best_iteration, record.best); !s.ok()) return s;
  }
  return std::move(record);
}

absl::StatusOr<JobProgress> ReadProgress(Connection& connection, const std::string& id) {
  auto statement = connection.Prepare("SELECT key, last_seq, iterations, iterations_removed_us FROM jobs WHERE id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return JobNotFound(id);
  return JobProgress{.key = statement->Int(0),
                     .last_seq = statement->Int(1),
                     .iterations = statement->Int(2),
                     .iterations_removed_us = statement->Int(3)};
}

// OK if the whole history is there.
absl::Status CheckNotRemoved(const std::string& id, const JobProgress& progress) {
  if (progress.iterations_removed_us == 0) return absl::OkStatus();
  return WithReason(
      absl::FailedPreconditionError(absl::StrCat("the iterations of jobs/", id,
                                                 " were removed, as this server keeps them for a time only; the job "
                                                 "itself still has the first, the best and the last")),
      "ITERATIONS_REMOVED");
}

// The iterations of least and of greatest cost within one stretch of a history.
struct Extremes {
  std::int64_t least = 0;  // 0: none yet
  std::int64_t greatest = 0;
  double least_cost = 0;
  double greatest_cost = 0;

  void Add(std::int64_t iteration, double cost) {
    if (std::isnan(cost)) cost = std::numeric_limits<double>::infinity();
    if (least == 0 || cost < least_cost) std::tie(least, least_cost) = std::tie(iteration, cost);
    if (greatest == 0 || cost > greatest_cost) std::tie(greatest, greatest_cost) = std::tie(iteration, cost);
  }
};

// Which iterations JobStore::SampleIterations shows of a history that has more than max_points. Reads two columns.
absl::StatusOr<std::set<std::int64_t>> PickIterations(Connection& connection, std::int64_t job_key,
                                                      IterationRange range, int max_points) {
  std::set<std::int64_t> picked{range.first, range.last};
  auto best = connection.Prepare("SELECT best_iteration FROM jobs WHERE key = ? AND best_iteration BETWEEN ? AND ?");
  if (!best.ok()) return best.status();
  absl::Status status = best->Bind(job_key, range.first, range.last).ForEachRow([&] {
    picked.insert(best->Int(0));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;

  std::vector<Extremes> stretches(static_cast<std::size_t>((max_points - 3) / 2));
  const auto count = static_cast<std::int64_t>(stretches.size());
  const std::int64_t span = static_cast<std::int64_t>(range.last) - range.first + 1;
  auto rows = connection.Prepare("SELECT iteration, cost FROM iterations WHERE job = ? AND iteration BETWEEN ? AND ?");
  if (!rows.ok()) return rows.status();
  status = rows->Bind(job_key, range.first, range.last).ForEachRow([&] {
    const std::int64_t iteration = rows->Int(0);
    stretches[static_cast<std::size_t>((iteration - range.first) * count / span)].Add(iteration, rows->Real(1));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  for (const Extremes& extremes : stretches) {
    if (extremes.least != 0) picked.insert({extremes.least, extremes.greatest});
  }
  return picked;
}

absl::StatusOr<IterationRecord> IterationIn(const Statement& row) {
  for (const int column : {1, 2, 3, 4, 5, 6, 8, 10}) {
    if (!row.IsNumberOrNull(column)) return absl::DataLossError("an iteration has a text for a number");
  }
  IterationRecord record;
  record.iteration = static_cast<int>(row.Int(0));
  for (int i = 0; i < kGainCount; ++i) record.gains[static_cast<std::size_t>(i)] = row.Real(1 + i);
  record.cost = row.Real(6);
  record.settling_samples = static_cast<int>(row.Int(7));
  record.fuel_sum = row.Real(8);
  const std::int64_t outcome = row.Int(9);
  if (outcome < 0 || outcome > static_cast<int>(Outcome::kNumericalFailure)) {
    return absl::DataLossError(absl::StrCat("an iteration has the unknown outcome ", outcome));
  }
  record.outcome = static_cast<Outcome>(outcome);
  record.cost_std = row.Real(10);
  record.pairs_left_out = static_cast<int>(row.Int(11));
  record.pairs_not_settled = static_cast<int>(row.Int(12));
  record.episodes = row.Int(13);
  return record;
}

// The number of state changes up to after_seq, and the changes in (after_seq, last].
struct StateChanges {
  std::int64_t before = 0;
  std::vector<JobEvent> events;
};

absl::StatusOr<JobEvent> StateChangeIn(const Statement& row) {
  StateChange change;
  const absl::StatusOr<JobState> state = JobStateOf(row.Text(1));
  if (!state.ok()) return state.status();
  change.state = *state;
  change.time_us = row.Int(2);
  change.message = row.Text(3);
  if (!row.IsNull(4)) {
    absl::StatusOr<JobReport> report = JobReportFromJson(row.Text(4));
    if (!report.ok()) return report.status();
    change.report = *std::move(report);
  }
  return JobEvent{.seq = row.Int(0), .what = std::move(change)};
}

absl::StatusOr<StateChanges> ReadStateChanges(Connection& connection, std::int64_t job_key, std::int64_t after_seq,
                                              std::int64_t last) {
  StateChanges changes;
  auto count = connection.Prepare("SELECT count(*) FROM job_events WHERE job = ? AND seq <= ?");
  if (!count.ok()) return count.status();
  const absl::StatusOr<bool> counted = count->Bind(job_key, after_seq).Step();
  if (!counted.ok()) return counted.status();
  changes.before = count->Int(0);
  auto statement = connection.Prepare(
      "SELECT seq, state, time_us, message, CASE state WHEN 'SUCCEEDED' THEN report END "
      "FROM job_events JOIN job_documents USING (job) WHERE job = ? AND seq > ? AND seq <= ? ORDER BY seq");
  if (!statement.ok()) return statement.status();
  absl::Status status = statement->Bind(job_key, after_seq, last).ForEachRow([&] {
    absl::StatusOr<JobEvent> event = StateChangeIn(*statement);
    if (event.ok()) changes.events.push_back(*std::move(event));
    return event.status();
  });
  if (!status.ok()) return status;
  return changes;
}

// Events after after_seq of a job whose iterations were removed: its state changes, and the iterations that are left.
absl::StatusOr<std::vector<JobEvent>> ReadEventsLeft(Connection& connection, const std::string& id,
                                                     const JobProgress& progress, std::int64_t after_seq, int limit) {
  absl::StatusOr<StateChanges> changes = ReadStateChanges(connection, progress.key, 0, progress.last_seq);
  if (!changes.ok()) return InJob(id, changes.status());
  std::vector<JobEvent> events = std::move(changes->events);
  const std::size_t change_count = events.size();
  auto best = connection.Prepare("SELECT coalesce(best_iteration, 1) FROM jobs WHERE key = ?");
  if (!best.ok()) return best.status();
  std::set<std::int64_t> left{1, progress.iterations};
  absl::Status status = best->Bind(progress.key).ForEachRow([&] {
    left.insert(best->Int(0));
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  for (const std::int64_t iteration : left) {
    const auto record = ReadIterations(connection, progress.key, iteration, 1);
    if (!record.ok()) return InJob(id, record.status());
    if (record->empty() || record->front().iteration != iteration) return MissingIteration(id, iteration);
    // Iterations have the numbers that state changes leave free.
    std::int64_t seq = iteration;
    for (std::size_t i = 0; i < change_count; ++i) seq += events[i].seq <= seq ? 1 : 0;
    events.push_back({.seq = seq, .what = record->front()});
  }
  std::ranges::sort(events, {}, &JobEvent::seq);
  std::erase_if(events, [&](const JobEvent& event) { return event.seq <= after_seq; });
  if (events.size() > static_cast<std::size_t>(std::max(limit, 0))) events.resize(static_cast<std::size_t>(limit));
  return events;
}

}  // namespace

absl::Status JobNotFound(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no job ", FormatReceived(id)));
}

absl::StatusOr<JobRecord> ReadJob(Connection& connection, const std::string& id) {
  auto statement = connection.Prepare(SelectJobs("report", " WHERE id = ?"));
  if (!statement.ok()) return statement.status();
  absl::StatusOr<std::vector<JobRow>> rows = ReadJobRows(statement->Bind(id));
  if (!rows.ok()) return rows.status();
  if (rows->empty()) return JobNotFound(id);
  return WithIterations(connection, std::move(rows->front()));
}

absl::StatusOr<std::vector<JobRecord>> ReadJobs(Connection& connection, const ListQuery& query) {
  auto statement = connection.PrepareOnce(SelectJobs("NULL", query.tail));
  if (!statement.ok()) return statement.status();
  absl::StatusOr<std::vector<JobRow>> rows = ReadJobRows(statement->BindAll(query.values));
  if (!rows.ok()) return rows.status();
  std::vector<JobRecord> jobs;
  for (JobRow& row : *rows) {
    absl::StatusOr<JobRecord> job = WithIterations(connection, std::move(row));
    if (!job.ok()) return job.status();
    jobs.push_back(*std::move(job));
  }
  return jobs;
}

absl::StatusOr<std::vector<IterationRecord>> ReadIterations(Connection& connection, std::int64_t job_key,
                                                            std::int64_t first, std::int64_t count) {
  auto statement = connection.Prepare(
      "SELECT iteration, k1, k2, k3, k4, k5, cost, settling_samples, fuel_sum, outcome, cost_std, pairs_left_out, "
      "pairs_not_settled, episodes FROM iterations WHERE job = ? AND iteration >= ? ORDER BY iteration LIMIT ?");
  if (!statement.ok()) return statement.status();
  std::vector<IterationRecord> records;
  absl::Status status = statement->Bind(job_key, first, count).ForEachRow([&] {
    const absl::StatusOr<IterationRecord> record = IterationIn(*statement);
    if (record.ok()) records.push_back(*record);
    return record.status();
  });
  if (!status.ok()) return status;
  return records;
}

absl::StatusOr<std::vector<IterationRecord>> ReadIterationsOf(Connection& connection, const std::string& id,
                                                              int after_iteration, int limit) {
  const absl::StatusOr<JobProgress> progress = ReadProgress(connection, id);
  if (!progress.ok()) return progress.status();
  if (absl::Status status = CheckNotRemoved(id, *progress); !status.ok()) return status;
  const std::int64_t after = std::max(after_iteration, 0);
  const std::int64_t count = std::clamp<std::int64_t>(progress->iterations - after, 0, std::max(limit, 0));
  auto records = ReadIterations(connection, progress->key, after + 1, count);
  if (!records.ok()) return InJob(id, records.status());
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const std::int64_t expected = after + 1 + static_cast<std::int64_t>(i);
    if (i >= records->size() || (*records)[i].iteration != expected) return MissingIteration(id, expected);
  }
  return records;
}

absl::StatusOr<std::vector<IterationRecord>> SampleIterationsOf(Connection& connection, const std::string& id,
                                                                IterationRange range, int max_points) {
  const absl::StatusOr<JobProgress> progress = ReadProgress(connection, id);
  if (!progress.ok()) return progress.status();
  if (absl::Status status = CheckNotRemoved(id, *progress); !status.ok()) return status;
  range.first = std::max(range.first, 1);
  range.last = static_cast<int>(std::min<std::int64_t>(range.last, progress->iterations));
  const std::int64_t count = static_cast<std::int64_t>(range.last) - range.first + 1;
  if (count <= 0) return std::vector<IterationRecord>();
  if (count <= max_points) return ReadIterationsOf(connection, id, range.first - 1, static_cast<int>(count));
  const auto picked = PickIterations(connection, progress->key, range, max_points);
  if (!picked.ok()) return InJob(id, picked.status());
  std::vector<IterationRecord> records;
  for (const std::int64_t iteration : *picked) {
    const auto found = ReadIterations(connection, progress->key, iteration, 1);
    if (!found.ok()) return InJob(id, found.status());
    if (found->empty() || found->front().iteration != iteration) return MissingIteration(id, iteration);
    records.push_back(found->front());
  }
  return records;
}

absl::StatusOr<std::vector<JobEvent>> ReadEventsOf(Connection& connection, const std::string& id,
                                                   std::int64_t after_seq, int limit) {
  const absl::StatusOr<JobProgress> progress = ReadProgress(connection, id);
  if (!progress.ok()) return progress.status();
  if (progress->iterations_removed_us != 0) return ReadEventsLeft(connection, id, *progress, after_seq, limit);
  const std::int64_t after = std::clamp<std::int64_t>(after_seq, 0, progress->last_seq);
  const std::int64_t last = after + std::min<std::int64_t>(progress->last_seq - after, std::max(limit, 0));
  absl::StatusOr<StateChanges> changes = ReadStateChanges(connection, progress->key, after, last);
  if (!changes.ok()) return InJob(id, changes.status());
  const std::int64_t iterations = last - after - static_cast<std::int64_t>(changes->events.size());
  auto records =
      ReadIterationsOf(connection, id, static_cast<int>(after - changes->before), static_cast<int>(iterations));
  if (!records.ok()) return records.status();

  std::vector<JobEvent> events;
  events.reserve(static_cast<std::size_t>(last - after));
  auto change = changes->events.begin();
  auto record = records->begin();
  for (std::int64_t seq = after + 1; seq <= last; ++seq) {
    if (change != changes->events.end() && change->seq == seq) {
      events.push_back(std::move(*change++));
    } else if (record != records->end()) {
      events.push_back({.seq = seq, .what = *record++});
    } else {
      return absl::DataLossError(absl::StrCat("job ", id, ": event ", seq, " is missing from its history"));
    }
  }
  return events;
}

}  // namespace orbitune
