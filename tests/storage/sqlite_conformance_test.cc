#include "storage/sqlite_store.h"
#include "tests/storage/job_store_conformance.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

class SqliteBackend final : public Backend {
 public:
  absl::StatusOr<std::unique_ptr<JobStore>> Open() override {
    return OpenSqliteStore({.path = directory_.File("orbitune.db")});
  }

 private:
  TemporaryDirectory directory_;
};

std::unique_ptr<Backend> MakeSqlite() { return std::make_unique<SqliteBackend>(); }

INSTANTIATE_TEST_SUITE_P(Sqlite, JobStoreConformance, testing::Values(&MakeSqlite));
INSTANTIATE_TEST_SUITE_P(Sqlite, CampaignStoreConformance, testing::Values(&MakeSqlite));
INSTANTIATE_TEST_SUITE_P(Sqlite, JobListConformance, testing::Values(&MakeSqlite));
INSTANTIATE_TEST_SUITE_P(Sqlite, GainStoreConformance, testing::Values(&MakeSqlite));
INSTANTIATE_TEST_SUITE_P(Sqlite, RetentionConformance, testing::Values(&MakeSqlite));

}  // namespace
}  // namespace orbitune::storage_test
