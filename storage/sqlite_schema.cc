#include "storage/sqlite_schema.h"

#include <array>
#include <string>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

// "ORBT": tells our databases from another program's.
constexpr std::int64_t kApplicationId = 0x4f524254;

// A job's own number (key) is never given twice, for the iterations of a deleted job go later than the job.
// The columns of doubles in `iterations` are ANY because SQLite would store -0.0 in a REAL column as 0.
constexpr std::string_view kVersion1 = R"sql(
CREATE TABLE jobs (
  key            INTEGER PRIMARY KEY AUTOINCREMENT,
  id             TEXT NOT NULL UNIQUE,
  state          TEXT NOT NULL,
  scenario_id    TEXT NOT NULL,
  create_time_us INTEGER NOT NULL,  -- microseconds since 1970, UTC
  start_time_us  INTEGER,
  end_time_us    INTEGER,
  update_time_us INTEGER NOT NULL,
  last_seq       INTEGER NOT NULL,
  state_changes  INTEGER NOT NULL,
  iterations     INTEGER NOT NULL,  -- completed
  best_iteration INTEGER,
  best_cost      REAL,
  request_id     TEXT UNIQUE,
  request_digest TEXT,
  error_message  TEXT NOT NULL
) STRICT;
CREATE INDEX jobs_by_create_time ON jobs (create_time_us, id);
CREATE INDEX jobs_by_best_cost ON jobs (best_cost, id);
CREATE INDEX jobs_by_state ON jobs (state, create_time_us, id);

CREATE TABLE job_documents (
  job    INTEGER PRIMARY KEY REFERENCES jobs (key) ON DELETE CASCADE,
  spec   TEXT NOT NULL,  -- JSON: the exact inputs
  report TEXT            -- JSON, where the job succeeded
) STRICT;

CREATE TABLE job_labels (
  job       INTEGER NOT NULL REFERENCES jobs (key) ON DELETE CASCADE,
  label_key TEXT NOT NULL,
  value     TEXT NOT NULL,
  PRIMARY KEY (job, label_key)
) STRICT, WITHOUT ROWID;
CREATE INDEX job_labels_by_label ON job_labels (label_key, value, job);

-- State changes only. A sequence number that is not here is an iteration: the iterations of a job, in order, take the
-- numbers that its state changes leave.
CREATE TABLE job_events (
  job     INTEGER NOT NULL REFERENCES jobs (key) ON DELETE CASCADE,
  seq     INTEGER NOT NULL,
  state   TEXT NOT NULL,
  time_us INTEGER NOT NULL,
  message TEXT NOT NULL,
  PRIMARY KEY (job, seq)
) STRICT, WITHOUT ROWID;

CREATE TABLE iterations (
  job               INTEGER NOT NULL,  -- jobs.key, or deleted_jobs.job
  iteration         INTEGER NOT NULL,  -- dense from 1
  k1 ANY, k2 ANY, k3 ANY, k4 ANY, k5 ANY,
  cost              ANY,               -- NULL: NaN, here and in every double
  settling_samples  INTEGER NOT NULL,
  fuel_sum          ANY,
  outcome           INTEGER NOT NULL,  -- 0 settled, 1 not settled, 2 left the domain, 3 numerical failure
  cost_std          ANY,
  pairs_left_out    INTEGER NOT NULL,
  pairs_not_settled INTEGER NOT NULL,
  PRIMARY KEY (job, iteration)
) STRICT, WITHOUT ROWID;

-- Jobs whose iterations are still to be removed.
CREATE TABLE deleted_jobs (
  job INTEGER PRIMARY KEY
) STRICT;
)sql";

// Searches whose state the newest iteration does not tell. All jobs of version 1 are ARS, of 2N + 1 episodes each.
constexpr std::string_view kVersion2 = R"sql(
CREATE TABLE checkpoints (
  job     INTEGER PRIMARY KEY REFERENCES jobs (key) ON DELETE CASCADE,  -- one that has not ended
  doubles BLOB NOT NULL  -- the search before the newest iteration: doubles, little-endian
) STRICT;

ALTER TABLE iterations ADD COLUMN episodes INTEGER NOT NULL DEFAULT 0;  -- flown up to and with this one
UPDATE iterations SET episodes = iteration * coalesce(
  (SELECT 2 * json_extract(spec, '$.scenario.search.directions') + 1 FROM job_documents
   WHERE job_documents.job = iterations.job), 0);
)sql";

// The gains and x(0) stand apart from the document, so that the library is read at start without it.
constexpr std::string_view kVersion3 = R"sql(
-- What the gain sets of one digest were flown in.
CREATE TABLE gain_scenarios (
  key        INTEGER PRIMARY KEY,
  digest     TEXT NOT NULL UNIQUE,  -- SHA-256 of what a cost depends on
  definition TEXT NOT NULL          -- JSON: a scenario with this digest
) STRICT;

-- No reference to jobs: a gain set stays when its job goes.
CREATE TABLE gain_sets (
  key            INTEGER PRIMARY KEY AUTOINCREMENT,
  id             TEXT NOT NULL UNIQUE,
  scenario       INTEGER NOT NULL REFERENCES gain_scenarios (key),
  kind           INTEGER NOT NULL,  -- 0 tuned, 1 robust, 2 mean, 3 imported
  k1 ANY, k2 ANY, k3 ANY, k4 ANY, k5 ANY,
  x1 ANY, x2 ANY, x3 ANY, x4 ANY, x5 ANY, x6 ANY,  -- x(0); all NULL: for several initial conditions
  create_time_us INTEGER NOT NULL,
  scenario_id    TEXT NOT NULL,
  job_id         TEXT NOT NULL,     -- '': none, here and below
  campaign_id    TEXT NOT NULL
) STRICT;
CREATE INDEX gain_sets_by_create_time ON gain_sets (create_time_us, id);
CREATE INDEX gain_sets_by_scenario ON gain_sets (scenario_id, create_time_us, id);
CREATE INDEX gain_sets_by_campaign ON gain_sets (campaign_id, create_time_us, id) WHERE campaign_id <> '';

CREATE TABLE gain_documents (
  gain_set INTEGER PRIMARY KEY REFERENCES gain_sets (key) ON DELETE CASCADE,
  document TEXT NOT NULL  -- JSON: names, units, initial condition, provenance, what flying it came to
) STRICT;
)sql";

// The indexes on jobs are made anew because lists leave the jobs of campaigns out.
constexpr std::string_view kVersion4 = R"sql(
ALTER TABLE jobs ADD COLUMN campaign TEXT;  -- campaigns.id, where the job is part of one
DROP INDEX jobs_by_create_time;
DROP INDEX jobs_by_best_cost;
CREATE INDEX jobs_by_create_time ON jobs (campaign, create_time_us, id);
CREATE INDEX jobs_by_best_cost ON jobs (campaign, best_cost, id);

CREATE TABLE campaigns (
  id             TEXT PRIMARY KEY,
  state          TEXT NOT NULL,
  scenario_id    TEXT NOT NULL,
  create_time_us INTEGER NOT NULL,
  end_time_us    INTEGER,
  update_time_us INTEGER NOT NULL,
  last_seq       INTEGER NOT NULL,
  state_changes  INTEGER NOT NULL,
  error_message  TEXT NOT NULL,
  spec           TEXT NOT NULL,  -- JSON: all inputs but the initial conditions
  results        TEXT            -- JSON, where the campaign succeeded
) STRICT, WITHOUT ROWID;
CREATE INDEX campaigns_by_create_time ON campaigns (create_time_us, id);
CREATE INDEX campaigns_by_state ON campaigns (state, create_time_us, id);

CREATE TABLE campaign_members (
  campaign          TEXT NOT NULL REFERENCES campaigns (id) ON DELETE CASCADE,
  role              INTEGER NOT NULL,  -- 0 tuned, 1 held out, 2 robust
  number            INTEGER NOT NULL,  -- dense from 1 in each role
  initial_condition TEXT,              -- JSON; NULL: that of all tuned
  job               INTEGER REFERENCES jobs (key),
  episodes          TEXT,              -- JSON: under each choice of gains, once they were compared
  PRIMARY KEY (campaign, role, number)
) STRICT, WITHOUT ROWID;
CREATE INDEX campaign_members_by_job ON campaign_members (job) WHERE job IS NOT NULL;

-- The end of a member's job (then with role, number, job and the job's state), or a change of the campaign's state.
CREATE TABLE campaign_events (
  campaign TEXT NOT NULL REFERENCES campaigns (id) ON DELETE CASCADE,
  seq      INTEGER NOT NULL,
  time_us  INTEGER NOT NULL,
  state    TEXT NOT NULL,
  role     INTEGER,
  number   INTEGER,
  job      TEXT,
  message  TEXT NOT NULL,
  PRIMARY KEY (campaign, seq)
) STRICT, WITHOUT ROWID;

CREATE TABLE campaign_requests (
  request_id TEXT PRIMARY KEY,
  digest     TEXT NOT NULL,
  campaign   TEXT NOT NULL REFERENCES campaigns (id) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;
)sql";

// Jobs that had ended before have neither; those that had not get both when the database is opened.
constexpr std::string_view kVersion5 = R"sql(
ALTER TABLE jobs ADD COLUMN digest TEXT;               -- of the history up to `iterations`: SHA-256 in hex
ALTER TABLE job_documents ADD COLUMN provenance TEXT;  -- JSON: what was given to the search, what computed
)sql";

// The iterations of such a job go later than this says (deleted_jobs): reads leave them alone from then on.
constexpr std::string_view kVersion6 = R"sql(
ALTER TABLE jobs ADD COLUMN iterations_removed_us INTEGER;  -- when all but the first, the best and the last went
)sql";

constexpr std::array kMigrations{kVersion1, kVersion2, kVersion3, kVersion4, kVersion5, kVersion6};

absl::StatusOr<bool> IsEmpty(Connection& connection) {
  const auto objects = connection.QueryInt("SELECT count(*) FROM sqlite_schema");
  if (!objects.ok()) return objects.status();
  return *objects == 0;
}

absl::Status ApplyMigration(Connection& connection, std::string_view script, std::int64_t version) {
  auto transaction = Transaction::Begin(connection, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  absl::Status status = connection.Execute(absl::StrCat(ToAbsl(script), ";\nPRAGMA application_id = ", kApplicationId,
                                                        ";\nPRAGMA user_version = ", version, ";"));
  return status.ok() ? transaction->Commit() : status;
}

}  // namespace

std::span<const std::string_view> Migrations() { return kMigrations; }

absl::Status CheckSchema(Connection& connection, std::int64_t newest) {
  const absl::StatusOr<bool> empty = IsEmpty(connection);
  if (!empty.ok()) return empty.status();
  const auto application = connection.QueryInt("PRAGMA application_id");
  if (!application.ok()) return application.status();
  if (!*empty && *application != kApplicationId) {
    return absl::FailedPreconditionError(
        absl::StrCat(connection.path(), " is a database of another program; choose another data directory"));
  }
  const auto version = connection.QueryInt("PRAGMA user_version");
  if (!version.ok()) return version.status();
  if (*version < 0 || *version > newest) {
    return absl::FailedPreconditionError(absl::StrCat(connection.path(), " has schema version ", *version,
                                                      ", but this server knows versions up to ", newest,
                                                      " only; run a newer server"));
  }
  return absl::OkStatus();
}

absl::Status Migrate(Connection& connection, std::span<const std::string_view> migrations) {
  const auto newest = static_cast<std::int64_t>(migrations.size());
  if (absl::Status status = CheckSchema(connection, newest); !status.ok()) return status;
  const auto version = connection.QueryInt("PRAGMA user_version");
  if (!version.ok()) return version.status();
  for (std::int64_t v = *version; v < newest; ++v) {
    absl::Status status = ApplyMigration(connection, migrations[static_cast<std::size_t>(v)], v + 1);
    if (!status.ok()) {
      return absl::Status(status.code(), absl::StrCat("bringing the database from schema version ", v, " to ", v + 1,
                                                      ": ", status.message()));
    }
  }
  return absl::OkStatus();
}

}  // namespace orbitune
