#include "storage/sqlite_provenance.h"

#include "absl/strings/str_cat.h"
#include "core/library/history_digest.h"
#include "core/library/scenario_digest.h"
#include "storage/serialise.h"
#include "storage/sqlite_job_queries.h"

namespace orbitune {
namespace {

constexpr int kPage = 10'000;

struct Job {
  std::int64_t key = 0;
  std::int64_t iterations = 0;
  JobSpec spec;
};

absl::StatusOr<std::vector<Job>> JobsWithout(Connection& connection) {
  auto statement = connection.PrepareOnce(
      "SELECT key, iterations, spec FROM jobs JOIN job_documents ON job_documents.job = jobs.key "
      "WHERE provenance IS NULL AND state IN ('QUEUED', 'RUNNING', 'PAUSED')");
  if (!statement.ok()) return statement.status();
  std::vector<Job> jobs;
  absl::Status status = statement->ForEachRow([&] {
    absl::StatusOr<JobSpec> spec = JobSpecFromJson(statement->Text(2));
    if (spec.ok()) jobs.push_back({statement->Int(0), statement->Int(1), *std::move(spec)});
    return spec.status();
  });
  if (!status.ok()) return status;
  return jobs;
}

absl::StatusOr<Provenance> ProvenanceOf(Connection& connection, const Job& job) {
  Provenance provenance = NewProvenance(job.spec);
  while (provenance.backfilled < job.iterations) {
    const auto page = ReadIterations(connection, job.key, provenance.backfilled + 1, kPage);
    if (!page.ok()) return page.status();
    for (const IterationRecord& record : *page) {
      if (record.iteration != provenance.backfilled + 1) break;
      provenance.digest = ExtendHistory(provenance.digest, record);
      if (++provenance.backfilled == job.iterations) return provenance;
    }
    if (page->size() < kPage) {
      return absl::DataLossError(absl::StrCat("iteration ", provenance.backfilled + 1, " of a job is missing"));
    }
  }
  return provenance;
}

}  // namespace

Provenance NewProvenance(const JobSpec& spec) {
  Provenance provenance;
  if (spec.scenario.Validate().ok()) provenance.scenario_digest = ScenarioDigest(spec.scenario);
  provenance.digest = Sha256(InputsText(provenance.scenario_digest, spec.scenario, spec.initial_condition,
                                        spec.initial_conditions, spec.objective));
  provenance.inputs_digest = ToHex(provenance.digest);
  return provenance;
}

absl::StatusOr<Provenance> ReadProvenance(std::string_view document, std::string_view digest) {
  absl::StatusOr<Provenance> provenance = ProvenanceFromJson(document);
  if (!provenance.ok()) return provenance;
  const std::optional<Digest> newest = DigestFromHex(digest);
  if (!newest) return absl::DataLossError(absl::StrCat("the digest ", FormatReceived(digest), " is none"));
  provenance->digest = *newest;
  return provenance;
}

absl::Status AddEngine(Connection& connection, std::int64_t job_key, const EngineStretch& stretch) {
  return connection.Run(
      "UPDATE job_documents SET provenance = json_insert(provenance, '$.engines[#]', json(?)) WHERE job = ?",
      ToJson(stretch), job_key);
}

absl::Status BackfillProvenance(Connection& connection) {
  const auto jobs = JobsWithout(connection);
  if (!jobs.ok()) return jobs.status();
  for (const Job& job : *jobs) {
    const auto provenance = ProvenanceOf(connection, job);
    if (!provenance.ok()) return provenance.status();
    auto transaction = Transaction::Begin(connection, Transaction::Kind::kWrite);
    if (!transaction.ok()) return transaction.status();
    absl::Status status =
        connection.Run("UPDATE job_documents SET provenance = ? WHERE job = ?", ToJson(*provenance), job.key);
    if (status.ok()) {
      status = connection.Run("UPDATE jobs SET digest = ? WHERE key = ?", ToHex(provenance->digest), job.key);
    }
    if (status.ok()) status = transaction->Commit();
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace orbitune
