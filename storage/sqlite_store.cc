#include "storage/sqlite_store.h"

#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"
#include "storage/sqlite_backup.h"
#include "storage/sqlite_campaign_store.h"
#include "storage/sqlite_check.h"
#include "storage/sqlite_gain_tables.h"
#include "storage/sqlite_job_queries.h"
#include "storage/sqlite_list_query.h"
#include "storage/sqlite_lock.h"
#include "storage/sqlite_provenance.h"
#include "storage/sqlite_reader_pool.h"
#include "storage/sqlite_retention_store.h"
#include "storage/sqlite_schema.h"
#include "storage/sqlite_writer.h"

namespace orbitune {
namespace {

class SqliteGainStore final : public GainStore {
 public:
  SqliteGainStore(SqliteReaderPool& readers, SqliteWriter& writer) : readers_(readers), writer_(writer) {}

  void AddGainSets(std::vector<GainSet> sets, Done done) override {
    writer_.Queue({.apply = [sets = std::move(sets)](JobTables& tables) { return tables.AddGainSets(sets); },
                   .answer = std::move(done),
                   .refusable = true});
  }
  void DeleteGainSet(const std::string& id, Done done) override {
    writer_.Queue({.apply = [id](JobTables& tables) { return tables.DeleteGainSet(id); },
                   .answer = std::move(done),
                   .refusable = true});
  }
  absl::StatusOr<GainSet> GetGainSet(const std::string& id) const override {
    return readers_.Run([&](Connection& connection) { return ReadGainSet(connection, id); });
  }
  absl::StatusOr<std::vector<GainSet>> ListGainSets(const GainSetQuery& query) const override {
    return readers_.Run([&](Connection& connection) { return ReadGainSets(connection, query); });
  }
  absl::Status ReadLibrary(const Shelf& shelf) const override {
    return readers_.Run([&](Connection& connection) { return ReadGainLibrary(connection, shelf); });
  }

 private:
  SqliteReaderPool& readers_;
  SqliteWriter& writer_;
};

class SqliteStore final : public JobStore {
 public:
  SqliteStore(std::unique_ptr<FileLock> lock, std::unique_ptr<Connection> connection, const SqliteStoreOptions& options)
      : lock_(std::move(lock)),
        connection_(std::move(connection)),
        readers_(connection_->path()),
        writer_(*connection_, options.first_retry_pause, options.metrics),
        campaigns_(*connection_, writer_, readers_),
        gains_(readers_, writer_),
        retention_(writer_, readers_) {}

  void CreateJob(std::string id, JobSpec spec, TimeUs now, std::string request_id, std::string request_digest,
                 Created done) override;
  void AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                       Continuation continuation, Done done) override;
  void ChangeState(const std::string& id, std::int64_t seq, StateChange change, Done done) override;
  void DeleteJob(const std::string& id, Done done) override;

  absl::StatusOr<JobRecord> GetJob(const std::string& id) const override;
  absl::StatusOr<std::vector<JobRecord>> ListJobs(const JobQuery& query) const override;
  absl::StatusOr<std::vector<JobRecord>> ListUnfinishedJobs() const override;
  absl::StatusOr<std::vector<IterationRecord>> ListIterations(const std::string& id, int after_iteration,
                                                              int limit) const override;
  absl::StatusOr<std::vector<IterationRecord>> SampleIterations(const std::string& id, IterationRange range,
                                                                int max_points) const override;
  absl::StatusOr<std::vector<JobEvent>> ListEvents(const std::string& id, std::int64_t after_seq,
                                                   int limit) const override;

  CampaignStore& campaigns() override { return campaigns_; }
  GainStore& gains() override { return gains_; }
  RetentionStore& retention() override { return retention_; }

  void Flush() override { writer_.Flush(); }
  absl::Status ok_for_now() const override { return writer_.trouble(); }

 private:
  // Destroyed from the last to the first: the writer ends, then the readers; the last connection tidies up the log; and
  // only then may another server come.
  const std::unique_ptr<FileLock> lock_;
  const std::unique_ptr<Connection> connection_;
  mutable SqliteReaderPool readers_;
  SqliteWriter writer_;
  SqliteCampaignStore campaigns_;
  SqliteGainStore gains_;
  SqliteRetentionStore retention_;
};

void SqliteStore::CreateJob(std::string id, JobSpec spec, TimeUs now, std::string request_id,
                            std::string request_digest, Created done) {
  absl::StatusOr<std::string> spec_json = ToJson(spec);
  if (!spec_json.ok()) {
    writer_.Queue({.apply = [fault = std::string(spec_json.status().message())](
                                JobTables&) { return absl::InvalidArgumentError(fault); },
                   .answer = std::move(done)});
    return;
  }
  Provenance provenance = NewProvenance(spec);
  auto job = std::make_shared<const JobToStore>(JobToStore{.id = std::move(id),
                                                           .spec = std::move(spec),
                                                           .spec_json = *std::move(spec_json),
                                                           .provenance = std::move(provenance),
                                                           .time_us = now,
                                                           .request_id = std::move(request_id),
                                                           .request_digest = std::move(request_digest)});
  auto created = std::make_shared<JobRecord>();
  const auto apply = [job, created](JobTables& tables) {
    absl::StatusOr<JobRecord> record = tables.CreateJob(*job);
    if (record.ok()) *created = *std::move(record);
    return record.status();
  };
  const auto answer = [created, done = std::move(done)](absl::Status status) {
    status.ok() ? done(std::move(*created)) : done(std::move(status));
  };
  writer_.Queue({.apply = apply, .answer = answer, .refusable = true});
}

void SqliteStore::AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                                  Continuation continuation, Done done) {
  writer_.Queue({.apply = [id, seq, record, continuation = std::move(continuation)](
                              JobTables& tables) { return tables.AppendIteration(id, seq, record, continuation); },
                 .answer = std::move(done),
                 .can_wait = true});
}

void SqliteStore::ChangeState(const std::string& id, std::int64_t seq, StateChange change, Done done) {
  const auto report_json = change.report ? std::optional(ToJson(*change.report)) : std::nullopt;
  writer_.Queue({.apply = [id, seq, change = std::move(change),
                           report_json](JobTables& tables) { return tables.ChangeState(id, seq, change, report_json); },
                 .answer = std::move(done)});
}

void SqliteStore::DeleteJob(const std::string& id, Done done) {
  writer_.Queue({.apply = [id](JobTables& tables) { return tables.DeleteJob(id); },
                 .answer = std::move(done),
                 .refusable = true});
}

absl::StatusOr<JobRecord> SqliteStore::GetJob(const std::string& id) const {
  return readers_.Run([&](Connection& connection) { return ReadJob(connection, id); });
}

absl::StatusOr<std::vector<JobRecord>> SqliteStore::ListJobs(const JobQuery& query) const {
  return readers_.Run([&](Connection& connection) -> absl::StatusOr<std::vector<JobRecord>> {
    std::vector<JobRecord> page;
    for (const ListQuery& stretch : MakeListQueries(query)) {
      auto jobs = ReadJobs(connection, stretch);
      if (!jobs.ok()) return jobs.status();
      for (JobRecord& job : *jobs) {
        if (page.size() < static_cast<std::size_t>(query.limit)) page.push_back(std::move(job));
      }
    }
    return page;
  });
}

absl::StatusOr<std::vector<JobRecord>> SqliteStore::ListUnfinishedJobs() const {
  return readers_.Run([](Connection& connection) { return ReadJobs(connection, MakeUnfinishedQuery()); });
}

absl::StatusOr<std::vector<IterationRecord>> SqliteStore::ListIterations(const std::string& id, int after_iteration,
                                                                         int limit) const {
  return readers_.Run([&](Connection& connection) { return ReadIterationsOf(connection, id, after_iteration, limit); });
}

absl::StatusOr<std::vector<IterationRecord>> SqliteStore::SampleIterations(const std::string& id, IterationRange range,
                                                                           int max_points) const {
  return readers_.Run([&](Connection& connection) { return SampleIterationsOf(connection, id, range, max_points); });
}

absl::StatusOr<std::vector<JobEvent>> SqliteStore::ListEvents(const std::string& id, std::int64_t after_seq,
                                                              int limit) const {
  return readers_.Run([&](Connection& connection) { return ReadEventsOf(connection, id, after_seq, limit); });
}

// The path with its directory's links resolved, so that all servers on it meet at one lock.
absl::StatusOr<std::filesystem::path> CheckPath(const std::string& path) {
  std::error_code error;
  const std::filesystem::path file = std::filesystem::absolute(path, error);
  const std::filesystem::path directory = std::filesystem::canonical(file.parent_path(), error);
  if (error) {
    return absl::ErrnoToStatus(error.value(), absl::StrCat("data directory ", file.parent_path().string()));
  }
  if (!std::filesystem::is_directory(directory, error)) {
    return absl::FailedPreconditionError(absl::StrCat(directory.string(), " is not a directory"));
  }
  if (std::filesystem::is_directory(file, error) || !file.has_filename()) {
    return absl::FailedPreconditionError(absl::StrCat(file.string(), " is a directory, not a database file"));
  }
  return directory / file.filename();
}

absl::Status TurnOnWriteAheadLog(Connection& connection) {
  // SQLite answers with the mode it could have.
  auto statement = connection.PrepareOnce("PRAGMA journal_mode = WAL");
  if (!statement.ok()) return statement.status();
  const absl::StatusOr<bool> row = statement->Step();
  if (!row.ok()) return row.status();
  if (statement->Text(0) != "wal") {
    return absl::FailedPreconditionError(absl::StrCat(
        connection.path(), ": its file system cannot hold a write-ahead log; choose a data directory on a local disk"));
  }
  if (absl::Status status = statement->Run(); !status.ok()) return status;
  // The size that the log falls back to after a burst, in bytes.
  return connection.Execute("PRAGMA synchronous = FULL; PRAGMA journal_size_limit = 16777216;");
}

void Log(const SqliteStoreOptions& options, const std::string& text) {
  if (options.log) options.log(text);
}

// crashed: the last server did not close the database.
absl::Status CheckAtStart(Connection& connection, bool crashed, const SqliteStoreOptions& options) {
  using StartCheck = SqliteStoreOptions::StartCheck;
  if (options.start_check == StartCheck::kFull) {
    const auto faults = FindFaults(connection);
    if (!faults.ok() || faults->empty()) return faults.status();
    return absl::DataLossError(absl::StrCat(connection.path(), ": ", faults->front()));
  }
  if (options.start_check == StartCheck::kNone || !crashed) return absl::OkStatus();
  const auto begin = std::chrono::steady_clock::now();
  const absl::StatusOr<bool> whole = QuickCheck(connection, options.start_check_limit);
  if (!whole.ok()) return whole.status();
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  Log(options, absl::StrCat("the last server did not close its database: checked for ", seconds.count(), " s, ",
                            *whole ? "no damage" : "no damage in what was read (`orbituned check` reads all of it)"));
  return absl::OkStatus();
}

absl::Status BackUpBeforeMigration(Connection& connection, const SqliteStoreOptions& options) {
  const auto newest = static_cast<std::int64_t>(Migrations().size());
  const auto version = connection.QueryInt("PRAGMA user_version");
  if (!version.ok()) return version.status();
  if (*version == 0 || *version == newest) return absl::OkStatus();
  const std::string destination = MigrationBackupName(connection.path(), *version);
  Log(options, absl::StrCat("bringing the database from schema version ", *version, " to ", newest,
                            "; as it was it stays in ", destination));
  const absl::Status status = BackUpDatabase(connection.path(), destination).status();
  if (status.ok()) return status;
  return absl::Status(
      status.code(), absl::StrCat("the database has schema version ", *version, ", this server needs ", newest,
                                  "; it is not changed, as the backup before that cannot be made: ", status.message()));
}

absl::StatusOr<std::unique_ptr<Connection>> OpenForWriting(const std::string& path, const SqliteStoreOptions& options) {
  std::error_code no_log;
  const bool crashed = std::filesystem::file_size(path + "-wal", no_log) > 0 && !no_log;
  auto connection = Connection::Open(path, Connection::Mode::kReadWrite);
  if (!connection.ok()) return connection;
  if ((*connection)->read_only()) return absl::PermissionDeniedError(absl::StrCat("cannot write ", path));
  absl::Status status = CheckSchema(**connection, static_cast<std::int64_t>(Migrations().size()));
  if (status.ok()) status = CheckAtStart(**connection, crashed, options);
  if (status.ok()) status = BackUpBeforeMigration(**connection, options);
  if (status.ok()) status = TurnOnWriteAheadLog(**connection);
  if (status.ok()) status = Migrate(**connection, Migrations());
  if (status.ok()) status = BackfillProvenance(**connection);
  if (!status.ok()) return status;
  return connection;
}

// What somebody whose database is damaged can do.
absl::Status WithWayForward(const absl::Status& status, const std::string& path) {
  if (!absl::IsDataLoss(status)) return status;
  const auto backups = MigrationBackupsBeside(path);
  return absl::DataLossError(absl::StrCat(
      status.message(), ". The database is damaged; nothing in it was changed. `orbituned check` says what is wrong; ",
      "`orbituned restore BACKUP` puts a backup in its place and keeps the damaged one",
      backups.empty() ? "" : absl::StrCat(" (the newest beside it is ", backups.back(), ")")));
}

}  // namespace

absl::StatusOr<std::unique_ptr<JobStore>> OpenSqliteStore(const SqliteStoreOptions& options) {
  const absl::StatusOr<std::filesystem::path> path = CheckPath(options.path);
  if (!path.ok()) return path.status();
  auto lock = FileLock::Take(LockPathOf(path->string()));
  if (!lock.ok()) return lock.status();
  auto connection = OpenForWriting(path->string(), options);
  if (!connection.ok()) return WithWayForward(connection.status(), path->string());
  return std::make_unique<SqliteStore>(*std::move(lock), *std::move(connection), options);
}

}  // namespace orbitune
