// The writes to the tables of jobs. They run inside a transaction that the caller (SqliteWriter) begins and commits,
// many to one transaction; how far each job has got is kept here meanwhile and written once, before the commit.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "storage/job_store.h"
#include "storage/sqlite_connection.h"

namespace orbitune {

// A job as it is created, its spec as JSON already.
struct JobToStore {
  std::string id;
  JobSpec spec;
  std::string spec_json;
  Provenance provenance;  // NewProvenance(spec)
  TimeUs time_us = 0;
  std::string request_id;
  std::string request_digest;
};

// Writer thread only, and the gain sets' tables with the jobs', for they are written together. A method that refuses
// (NOT_FOUND, ALREADY_EXISTS, INTERNAL for a seq or an id that a bug gave) has written nothing. After an error of the
// connection the transaction must be rolled back.
class JobTables {
 public:
  // connection outlives this.
  explicit JobTables(Connection& connection) : connection_(connection) {}

  // As JobStore's methods of these names.
  absl::StatusOr<JobRecord> CreateJob(const JobToStore& job);
  absl::Status AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                               const Continuation& continuation);
  // report_json: of change.report, NULL without one.
  absl::Status ChangeState(const std::string& id, std::int64_t seq, const StateChange& change,
                           const std::optional<std::string>& report_json);
  // As RetentionStore's.
  absl::Status RemoveIterations(const std::string& id, TimeUs now);
  // The job's iterations stay behind, unreachable, for RemoveLeftovers.
  absl::Status DeleteJob(const std::string& id);

  // As GainStore's methods of these names.
  absl::Status AddGainSets(const std::vector<GainSet>& sets);
  absl::Status DeleteGainSet(const std::string& id);

  // To be called before the commit.
  absl::Status WriteProgress();
  // To be called before a transaction begins.
  void Forget();
  // In this transaction.
  bool deleted_any() const { return deleted_any_; }

  // Removes a bounded number of iterations of jobs deleted, or left without them (some milliseconds); false: there were
  // none.
  absl::StatusOr<bool> RemoveLeftovers();

 private:
  // How far a job has got in this transaction.
  struct Head {
    std::int64_t key = 0;
    std::int64_t last_seq = 0;
    std::int64_t iterations = 0;
    std::optional<IterationRecord> best;
    std::vector<double> checkpoint;  // empty: none to be written
    std::optional<Digest> digest;    // none: none to be written
    bool progress_changed = false;
    bool best_changed = false;
  };

  // Valid until Forget or DeleteJob.
  absl::StatusOr<Head*> FindHead(const std::string& id);
  absl::StatusOr<Head*> FindHeadForEvent(const std::string& id, std::int64_t seq);
  absl::Status WriteHead(Head& head);
  absl::StatusOr<std::optional<JobRecord>> FindByRequest(const JobToStore& job);
  absl::Status InsertJob(const JobToStore& job);
  absl::Status InsertStateChange(std::int64_t job_key, std::int64_t seq, const StateChange& change);

  Connection& connection_;
  std::map<std::string, Head, std::less<>> heads_;
  bool deleted_any_ = false;
};

}  // namespace orbitune
