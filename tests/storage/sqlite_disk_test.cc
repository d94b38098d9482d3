// A disk that fails for a while: nothing is answered before it is committed, nothing is lost, and reads go on.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "absl/strings/match.h"
#include "storage/sqlite_store.h"
#include "tests/storage/faulty_disk.h"
#include "tests/storage/sqlite_support.h"
#include "tests/storage/store_support.h"

namespace orbitune::storage_test {
namespace {

using Fault = FaultyDisk::Fault;

struct FaultCase {
  Fault fault;
  const char* words;  // of the reason
};

class SqliteDisk : public testing::TestWithParam<FaultCase> {
 protected:
  void SetUp() override {
    store_ = OpenStore(directory_.File("orbitune.db"));
    ASSERT_NE(store_, nullptr);
    ASSERT_TRUE(Create(*store_, "a").ok());
    ASSERT_TRUE(Append(*store_, "a", 2, RecordOf(1)).ok());
  }

  void AwaitTrouble() {
    for (int i = 0; i < 6000 && store_->ok_for_now().ok(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    ASSERT_FALSE(store_->ok_for_now().ok());
  }

  TemporaryDirectory directory_;
  FaultyDisk disk_;
  std::unique_ptr<JobStore> store_;  // ends before its disk
};

TEST_P(SqliteDisk, WritesWaitAndGoOn) {
  disk_.Set(GetParam().fault);
  std::atomic<int> answered = 0;
  for (int i = 2; i <= 100; ++i) {
    store_->AppendIteration("a", i + 1, RecordOf(i), {}, [&](const absl::Status& status) {
      EXPECT_TRUE(status.ok()) << status;
      ++answered;
    });
  }
  AwaitTrouble();
  const absl::Status reason = store_->ok_for_now();
  EXPECT_TRUE(absl::IsUnavailable(reason)) << reason;
  EXPECT_TRUE(absl::StrContains(reason.message(), GetParam().words)) << reason;
  EXPECT_TRUE(absl::StrContains(reason.message(), "orbitune.db")) << reason;
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(answered, 0);
  const auto job = store_->GetJob("a");
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->last_seq, 2);
  EXPECT_EQ(store_->ListEvents("a", 0, 100)->size(), 2);

  disk_.Set(Fault::kNone);
  store_->Flush();
  EXPECT_EQ(answered, 99);
  EXPECT_TRUE(store_->ok_for_now().ok()) << store_->ok_for_now();
  EXPECT_EQ(store_->GetJob("a")->completed_iterations(), 100);
}

TEST_P(SqliteDisk, ClosingAnswersWhatCannotBeWritten) {
  disk_.Set(GetParam().fault);
  std::vector<absl::Status> answers;
  for (int i = 2; i <= 3000; ++i) {
    store_->AppendIteration("a", i + 1, RecordOf(i), {},
                            [&](const absl::Status& status) { answers.push_back(status); });
  }
  AwaitTrouble();
  store_.reset();
  ASSERT_EQ(answers.size(), 2999);
  for (const absl::Status& status : answers) ASSERT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_TRUE(absl::StrContains(answers[0].message(), GetParam().words)) << answers[0];
  disk_.Set(Fault::kNone);
  store_ = OpenStore(directory_.File("orbitune.db"));
  // Where only the sync failed, what was not answered may be there all the same.
  const auto job = store_->GetJob("a");
  ASSERT_TRUE(job.ok()) << job.status();
  if (GetParam().fault != Fault::kSyncError) {
    EXPECT_EQ(job->completed_iterations(), 1);
  }
  EXPECT_EQ(store_->ListEvents("a", 0, 5000)->size(), job->last_seq);
}

// The fault comes and goes at any moment.
TEST_P(SqliteDisk, LosesNothingWhenFaultsComeAndGo) {
  constexpr int kIterations = 2000;
  std::atomic<bool> stop = false;
  std::thread trouble([&] {
    for (int i = 0; !stop; ++i) {
      disk_.Set(i % 2 == 0 ? GetParam().fault : Fault::kNone);
      std::this_thread::sleep_for(std::chrono::microseconds(500 + 4000 * (i % 2)));
    }
    disk_.Set(Fault::kNone);
  });
  int answered = 1;
  for (int i = 2; i <= kIterations; ++i) {
    store_->AppendIteration("a", i + 1, RecordOf(i), {}, [&answered, i](const absl::Status& status) {
      ASSERT_TRUE(status.ok()) << status;
      ASSERT_EQ(i, ++answered);
    });
    if (i % 10 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  stop = true;
  trouble.join();
  store_.reset();
  store_ = OpenStore(directory_.File("orbitune.db"));
  const auto records = store_->ListIterations("a", 0, 2 * kIterations);
  ASSERT_TRUE(records.ok()) << records.status();
  ASSERT_EQ(records->size(), kIterations);
  for (int i = 1; i <= kIterations; ++i) {
    ASSERT_TRUE(Identical((*records)[static_cast<std::size_t>(i - 1)], RecordOf(i)));
  }
  EXPECT_EQ(QueryInt(directory_.File("orbitune.db"),
                     "SELECT count(*) FROM pragma_integrity_check WHERE integrity_check = 'ok'"),
            1);
}

TEST_P(SqliteDisk, DoesNotOpenOnIt) {
  store_.reset();
  const std::string other = directory_.File("other.db");
  disk_.Set(GetParam().fault);
  const absl::Status status = OpenError(other);
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_TRUE(absl::StrContains(status.message(), other)) << status;
  disk_.Set(Fault::kNone);
  EXPECT_NE(OpenStore(other), nullptr);
}

INSTANTIATE_TEST_SUITE_P(Faults, SqliteDisk,
                         testing::Values(FaultCase{Fault::kFull, "full"}, FaultCase{Fault::kWriteError, "I/O error"},
                                         FaultCase{Fault::kSyncError, "I/O error"}),
                         [](const auto& tested) {
                           return tested.param.fault == Fault::kFull         ? "DiskFull"
                                  : tested.param.fault == Fault::kWriteError ? "WriteError"
                                                                             : "SyncError";
                         });

}  // namespace
}  // namespace orbitune::storage_test
