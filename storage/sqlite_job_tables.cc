#include "storage/sqlite_job_tables.h"

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_gain_tables.h"
#include "storage/sqlite_job_queries.h"
#include "storage/sqlite_provenance.h"

namespace orbitune {
namespace {

// Some 4 ms.
constexpr std::int64_t kLeftoversAtOnce = 2000;

std::optional<std::string> NullIfEmpty(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional(text);
}

std::optional<TimeUs> TimeIf(bool condition, TimeUs time_us) {
  return condition ? std::optional(time_us) : std::nullopt;
}

}  // namespace

void JobTables::Forget() {
  heads_.clear();
  deleted_any_ = false;
}

absl::StatusOr<JobTables::Head*> JobTables::FindHead(const std::string& id) {
  if (const auto known = heads_.find(id); known != heads_.end()) return &known->second;
  auto statement = connection_.Prepare("SELECT key, last_seq, iterations, best_iteration FROM jobs WHERE id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return JobNotFound(id);
  Head head{.key = statement->Int(0), .last_seq = statement->Int(1), .iterations = statement->Int(2), .best = {}};
  if (!statement->IsNull(3)) {
    const auto best = ReadIterations(connection_, head.key, statement->Int(3), 1);
    if (!best.ok()) return best.status();
    if (best->empty()) return absl::DataLossError(absl::StrCat("job ", id, ": its best iteration is missing"));
    head.best = best->front();
  }
  return &heads_.emplace(id, head).first->second;
}

absl::StatusOr<JobTables::Head*> JobTables::FindHeadForEvent(const std::string& id, std::int64_t seq) {
  absl::StatusOr<Head*> head = FindHead(id);
  if (head.ok() && seq != (*head)->last_seq + 1) {
    return absl::InternalError(absl::StrCat("job ", id, ": event ", seq, " cannot follow event ", (*head)->last_seq));
  }
  return head;
}

absl::StatusOr<std::optional<JobRecord>> JobTables::FindByRequest(const JobToStore& job) {
  if (job.request_id.empty()) return std::nullopt;
  auto statement = connection_.Prepare("SELECT id, request_digest FROM jobs WHERE request_id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(job.request_id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return std::nullopt;
  const std::string earlier = statement->Text(0);
  if (statement->Text(1) != job.request_digest) {
    return WithReason(
        absl::AlreadyExistsError(absl::StrCat("request id ", FormatReceived(job.request_id),
                                              " was used for another request, which created job ", earlier)),
        "REQUEST_ID_REUSED");
  }
  if (absl::Status status = WriteProgress(); !status.ok()) return status;
  return ReadJob(connection_, earlier);
}

absl::StatusOr<JobRecord> JobTables::CreateJob(const JobToStore& job) {
  absl::StatusOr<std::optional<JobRecord>> earlier = FindByRequest(job);
  if (!earlier.ok()) return earlier.status();
  if (*earlier) return **std::move(earlier);
  const absl::StatusOr<Head*> same_id = FindHead(job.id);
  if (same_id.ok()) return absl::InternalError(absl::StrCat("job id ", job.id, " is taken"));
  if (!absl::IsNotFound(same_id.status())) return same_id.status();
  if (absl::Status status = InsertJob(job); !status.ok()) return status;
  JobRecord record;
  record.id = job.id;
  record.spec = job.spec;
  record.create_time_us = record.update_time_us = job.time_us;
  record.last_seq = record.state_changes = 1;
  record.provenance = job.provenance;
  return record;
}

absl::Status JobTables::InsertJob(const JobToStore& job) {
  absl::Status status = connection_.Run(
      "INSERT INTO jobs (id, state, scenario_id, create_time_us, update_time_us, last_seq, state_changes, iterations, "
      "request_id, request_digest, campaign, error_message, digest) VALUES (?, ?, ?, ?, ?, 1, 1, 0, ?, ?, ?, '', ?)",
      job.id, NameOf(JobState::kQueued), job.spec.scenario.id, job.time_us, job.time_us, NullIfEmpty(job.request_id),
      job.request_digest, NullIfEmpty(job.spec.campaign_id), ToHex(job.provenance.digest));
  if (!status.ok()) return status;
  const std::int64_t key = connection_.last_insert_key();
  status = connection_.Run("INSERT INTO job_documents (job, spec, provenance) VALUES (?, ?, ?)", key, job.spec_json,
                           ToJson(job.provenance));
  for (const auto& [label_key, value] : job.spec.labels) {
    if (!status.ok()) return status;
    status = connection_.Run("INSERT INTO job_labels (job, label_key, value) VALUES (?, ?, ?)", key, label_key, value);
  }
  if (!status.ok()) return status;
  return InsertStateChange(key, 1, {.state = JobState::kQueued, .time_us = job.time_us, .message = {}, .report = {}});
}

absl::Status JobTables::InsertStateChange(std::int64_t job_key, std::int64_t seq, const StateChange& change) {
  return connection_.Run("INSERT INTO job_events (job, seq, state, time_us, message) VALUES (?, ?, ?, ?, ?)", job_key,
                         seq, NameOf(change.state), change.time_us, change.message);
}

absl::Status JobTables::AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                                        const Continuation& continuation) {
  const absl::StatusOr<Head*> found = FindHeadForEvent(id, seq);
  if (!found.ok()) return found.status();
  Head& head = **found;
  if (record.iteration != head.iterations + 1) {
    return absl::InternalError(
        absl::StrCat("job ", id, ": iteration ", record.iteration, " cannot follow iteration ", head.iterations));
  }
  const Gains& k = record.gains;
  absl::Status status = connection_.Run(
      "INSERT INTO iterations (job, iteration, k1, k2, k3, k4, k5, cost, settling_samples, fuel_sum, outcome, "
      "cost_std, pairs_left_out, pairs_not_settled, episodes) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
      head.key, record.iteration, k[0], k[1], k[2], k[3], k[4], record.cost, record.settling_samples, record.fuel_sum,
      static_cast<int>(record.outcome), record.cost_std, record.pairs_left_out, record.pairs_not_settled,
      record.episodes);
  if (status.ok() && continuation.engine) {
    status = AddEngine(connection_, head.key, {record.iteration, *continuation.engine});
  }
  if (!status.ok()) return status;
  head.last_seq = seq;
  head.iterations = record.iteration;
  head.progress_changed = true;
  head.digest = continuation.digest;
  if (!continuation.checkpoint.empty()) head.checkpoint = continuation.checkpoint;
  if (!head.best || Better(record, *head.best)) {
    head.best = record;
    head.best_changed = true;
  }
  return absl::OkStatus();
}

absl::Status JobTables::ChangeState(const std::string& id, std::int64_t seq, const StateChange& change,
                                    const std::optional<std::string>& report_json) {
  const absl::StatusOr<Head*> found = FindHeadForEvent(id, seq);
  if (!found.ok()) return found.status();
  Head& head = **found;
  if (absl::Status status = InsertStateChange(head.key, seq, change); !status.ok()) return status;
  const bool running = change.state == JobState::kRunning;
  const bool failed = change.state == JobState::kFailed;
  absl::Status status = connection_.Run(
      "UPDATE jobs SET state = ?, update_time_us = ?, start_time_us = coalesce(start_time_us, ?), "
      "end_time_us = coalesce(?, end_time_us), error_message = coalesce(?, error_message), "
      "state_changes = state_changes + 1 WHERE key = ?",
      NameOf(change.state), change.time_us, TimeIf(running, change.time_us),
      TimeIf(IsTerminal(change.state), change.time_us), failed ? std::optional(change.message) : std::nullopt,
      head.key);
  if (status.ok() && report_json) {
    status = connection_.Run("UPDATE job_documents SET report = ? WHERE job = ?", *report_json, head.key);
  }
  if (status.ok() && IsTerminal(change.state)) {
    status = connection_.Run("DELETE FROM checkpoints WHERE job = ?", head.key);
    head.checkpoint.clear();
  }
  if (status.ok() && change.gain_set) status = InsertGainSet(connection_, *change.gain_set);
  if (!status.ok()) return status;
  head.last_seq = seq;
  head.progress_changed = true;
  return absl::OkStatus();
}

absl::Status JobTables::AddGainSets(const std::vector<GainSet>& sets) {
  for (const GainSet& set : sets) {
    if (absl::Status status = InsertGainSet(connection_, set); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status JobTables::DeleteGainSet(const std::string& id) { return RemoveGainSet(connection_, id); }

absl::Status JobTables::DeleteJob(const std::string& id) {
  const absl::StatusOr<Head*> head = FindHead(id);
  if (!head.ok()) return head.status();
  const std::int64_t key = (*head)->key;
  if ((*head)->iterations > 0) {
    absl::Status status = connection_.Run("INSERT OR IGNORE INTO deleted_jobs (job) VALUES (?)", key);
    if (!status.ok()) return status;
  }
  // Documents, labels and events go with it.
  absl::Status status = connection_.Run("DELETE FROM jobs WHERE key = ?", key);
  if (!status.ok()) return status;
  heads_.erase(id);
  deleted_any_ = true;
  return absl::OkStatus();
}

absl::Status JobTables::RemoveIterations(const std::string& id, TimeUs now) {
  auto statement = connection_.Prepare("SELECT key, state FROM jobs WHERE id = ?");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Bind(id).Step();
  if (!row.ok()) return row.status();
  if (!*row) return JobNotFound(id);
  const std::int64_t key = statement->Int(0);
  const absl::StatusOr<JobState> state = JobStateOf(statement->Text(1));
  if (!state.ok()) return state.status();
  if (!IsTerminal(*state)) return absl::FailedPreconditionError(absl::StrCat("job ", id, " has not ended"));
  absl::Status status = connection_.Run("UPDATE jobs SET iterations_removed_us = ? WHERE key = ?", now, key);
  if (status.ok()) status = connection_.Run("INSERT OR IGNORE INTO deleted_jobs (job) VALUES (?)", key);
  if (!status.ok()) return status;
  deleted_any_ = true;
  return absl::OkStatus();
}

absl::Status JobTables::WriteHead(Head& head) {
  if (head.progress_changed) {
    const auto digest = head.digest ? std::optional(ToHex(*head.digest)) : std::nullopt;
    absl::Status status =
        connection_.Run("UPDATE jobs SET last_seq = ?, iterations = ?, digest = coalesce(?, digest) WHERE key = ?",
                        head.last_seq, head.iterations, digest, head.key);
    if (!status.ok()) return status;
    head.progress_changed = false;
    head.digest.reset();
  }
  if (!head.checkpoint.empty()) {
    absl::Status status =
        connection_.Run("INSERT OR REPLACE INTO checkpoints (job, doubles) VALUES (?, ?)", head.key, head.checkpoint);
    if (!status.ok()) return status;
    head.checkpoint.clear();
  }
  if (head.best_changed) {
    absl::Status status = connection_.Run("UPDATE jobs SET best_iteration = ?, best_cost = ? WHERE key = ?",
                                          head.best->iteration, head.best->cost, head.key);
    if (!status.ok()) return status;
    head.best_changed = false;
  }
  return absl::OkStatus();
}

absl::Status JobTables::WriteProgress() {
  for (auto& [id, head] : heads_) {
    if (absl::Status status = WriteHead(head); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::StatusOr<bool> JobTables::RemoveLeftovers() {
  const auto job = connection_.QueryInt("SELECT job FROM deleted_jobs LIMIT 1");
  if (absl::IsNotFound(job.status())) return false;
  if (!job.ok()) return job.status();
  absl::Status status = connection_.Run(
      "DELETE FROM iterations WHERE job = ?1 AND iteration IN "
      "(SELECT iteration FROM iterations WHERE job = ?1 AND iteration NOT IN "
      "(SELECT 1 FROM jobs WHERE key = ?1 UNION SELECT iterations FROM jobs WHERE key = ?1 "
      "UNION SELECT coalesce(best_iteration, 1) FROM jobs WHERE key = ?1) LIMIT ?2)",
      *job, kLeftoversAtOnce);
  if (status.ok() && connection_.rows_changed() < kLeftoversAtOnce) {
    status = connection_.Run("DELETE FROM deleted_jobs WHERE job = ?", *job);
  }
  if (!status.ok()) return status;
  return true;
}

}  // namespace orbitune
