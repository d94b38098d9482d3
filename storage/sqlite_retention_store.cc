#include "storage/sqlite_retention_store.h"

#include <string_view>

namespace orbitune {
namespace {

// sql: id and end time of what ended before ?1, at most ?2.
absl::StatusOr<std::vector<RetentionStore::Ended>> ReadEnded(SqliteReaderPool& readers, std::string_view sql,
                                                             TimeUs time_us, int limit) {
  return readers.Run([&](Connection& connection) -> absl::StatusOr<std::vector<RetentionStore::Ended>> {
    std::vector<RetentionStore::Ended> ended;
    auto statement = connection.Prepare(sql);
    if (!statement.ok()) return statement.status();
    absl::Status status = statement->Bind(time_us, limit).ForEachRow([&] {
      ended.push_back({.id = statement->Text(0), .end_time_us = statement->Int(1)});
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return ended;
  });
}

}  // namespace

absl::StatusOr<std::vector<RetentionStore::Ended>> SqliteRetentionStore::JobsEndedBefore(TimeUs time_us,
                                                                                         int limit) const {
  return ReadEnded(readers_,
                   "SELECT id, end_time_us FROM jobs WHERE campaign IS NULL AND end_time_us < ? "
                   "AND state IN ('SUCCEEDED', 'FAILED', 'CANCELLED') ORDER BY end_time_us, id LIMIT ?",
                   time_us, limit);
}

absl::StatusOr<std::vector<RetentionStore::Ended>> SqliteRetentionStore::CampaignsEndedBefore(TimeUs time_us,
                                                                                              int limit) const {
  return ReadEnded(readers_,
                   "SELECT id, end_time_us FROM campaigns WHERE end_time_us < ? "
                   "AND state IN ('SUCCEEDED', 'FAILED', 'CANCELLED') ORDER BY end_time_us, id LIMIT ?",
                   time_us, limit);
}

absl::StatusOr<std::vector<RetentionStore::Ended>> SqliteRetentionStore::HistoriesEndedBefore(TimeUs time_us,
                                                                                              int limit) const {
  return ReadEnded(
      readers_,
      "SELECT id, ended FROM (SELECT jobs.id, iif(campaign IS NULL, jobs.end_time_us, campaigns.end_time_us) "
      "AS ended FROM jobs LEFT JOIN campaigns ON campaigns.id = campaign "
      "WHERE jobs.state IN ('SUCCEEDED', 'FAILED', 'CANCELLED') AND iterations > 3 "
      "AND iterations_removed_us IS NULL "
      "AND (campaign IS NULL OR campaigns.state IN ('SUCCEEDED', 'FAILED', 'CANCELLED'))) "
      "WHERE ended < ? ORDER BY ended, id LIMIT ?",
      time_us, limit);
}

void SqliteRetentionStore::RemoveIterations(const std::string& job_id, TimeUs now, Done done) {
  writer_.Queue({.apply = [job_id, now](JobTables& tables) { return tables.RemoveIterations(job_id, now); },
                 .answer = std::move(done),
                 .refusable = true});
}

absl::StatusOr<RetentionStore::Usage> SqliteRetentionStore::GetUsage() const {
  return readers_.Run([](Connection& connection) -> absl::StatusOr<Usage> {
    const auto pages = connection.QueryInt(
        "SELECT (page_count - freelist_count) * page_size FROM pragma_page_count, pragma_freelist_count, "
        "pragma_page_size");
    if (!pages.ok()) return pages.status();
    const auto removing = connection.QueryInt("SELECT EXISTS (SELECT * FROM deleted_jobs)");
    if (!removing.ok()) return removing.status();
    return Usage{.bytes = *pages, .removing = *removing != 0};
  });
}

}  // namespace orbitune
