// The retention's part of the SQLite store: the same file, the same writer, the same readers.
#pragma once

#include "storage/retention_store.h"
#include "storage/sqlite_reader_pool.h"
#include "storage/sqlite_writer.h"

namespace orbitune {

class SqliteRetentionStore final : public RetentionStore {
 public:
  // Both outlive this, which queues nothing that is not answered before the writer ends.
  SqliteRetentionStore(SqliteWriter& writer, SqliteReaderPool& readers) : writer_(writer), readers_(readers) {}

  absl::StatusOr<std::vector<Ended>> JobsEndedBefore(TimeUs time_us, int limit) const override;
  absl::StatusOr<std::vector<Ended>> CampaignsEndedBefore(TimeUs time_us, int limit) const override;
  absl::StatusOr<std::vector<Ended>> HistoriesEndedBefore(TimeUs time_us, int limit) const override;
  void RemoveIterations(const std::string& job_id, TimeUs now, Done done) override;
  absl::StatusOr<Usage> GetUsage() const override;

 private:
  SqliteWriter& writer_;
  SqliteReaderPool& readers_;
};

}  // namespace orbitune
