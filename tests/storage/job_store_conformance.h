// What every JobStore must do, whatever it keeps its jobs in. A backend joins with
//   INSTANTIATE_TEST_SUITE_P(Name, JobStoreConformance, testing::Values(&MakeTheBackend));
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "storage/job_store.h"

namespace orbitune::storage_test {

// A place to keep jobs in. A store opened after the last one was closed has what that one had.
class Backend {
 public:
  virtual ~Backend() = default;
  virtual absl::StatusOr<std::unique_ptr<JobStore>> Open() = 0;
};

using MakeBackend = std::unique_ptr<Backend> (*)();

class JobStoreConformance : public testing::TestWithParam<MakeBackend> {
 protected:
  void SetUp() override;
  void Reopen();
  JobStore& store() { return *store_; }

  std::unique_ptr<Backend> backend_;
  std::unique_ptr<JobStore> store_;
};

// The gain sets' (gain_store_conformance.cc).
class GainStoreConformance : public JobStoreConformance {};

// The campaigns' (campaign_store_conformance.cc); each write waits for its answer.
class CampaignStoreConformance : public JobStoreConformance {
 protected:
  CampaignStore& campaigns() { return store().campaigns(); }
  absl::StatusOr<WrittenCampaign> Create(const NewCampaign& campaign);
  absl::Status Append(const std::string& id, std::int64_t seq, const MemberEnded& ended);
  absl::Status Change(const std::string& id, std::int64_t seq, const CampaignStateChange& change);
  absl::Status Delete(const std::string& id);
};

// What retention needs (retention_conformance.cc).
class RetentionConformance : public JobStoreConformance {
 protected:
  // Until what was removed is gone from the disk.
  void AwaitRemoval();
};

// The listings' conformance (job_list_conformance.cc).
class JobListConformance : public JobStoreConformance {};

}  // namespace orbitune::storage_test
