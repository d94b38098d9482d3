// What the tests of the store share: jobs with odd values, writes that wait for their answer, comparisons bit by bit.
#pragma once

#include <filesystem>
#include <string>

#include "storage/job_store.h"

namespace orbitune::storage_test {

// A directory of its own, removed with all that is in it.
class TemporaryDirectory {
 public:
  TemporaryDirectory() : TemporaryDirectory(std::filesystem::temp_directory_path()) {}
  explicit TemporaryDirectory(const std::filesystem::path& parent);
  ~TemporaryDirectory();
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::string File(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

// Every field differs from its default; doubles that decimals do not reach, texts with quotes, controls and no ASCII.
JobSpec OddSpec();
// A preset's.
JobSpec PlainSpec(const std::string& display_name = "a job");
JobReport OddReport();
// Digits in every double; some with NaN, as failed episodes have.
IterationRecord RecordOf(int iteration);
IterationRecord RecordWith(int iteration, Outcome outcome, double cost);
StateChange ChangeTo(JobState state, TimeUs time_us = 1, std::string message = "");

// Every field differs from its default. Its scenario is a preset's, so that it has a digest.
GainSet OddGainSet(const std::string& id);
GainSet PlainGainSet(const std::string& id, std::int64_t create_time_us = 1);

// Each waits for the answer.
absl::StatusOr<JobRecord> Create(JobStore& store, const std::string& id, const JobSpec& spec = PlainSpec(),
                                 TimeUs now = 1, const std::string& request_id = "", const std::string& digest = "");
absl::Status Append(JobStore& store, const std::string& id, std::int64_t seq, const IterationRecord& record);
absl::Status Change(JobStore& store, const std::string& id, std::int64_t seq, const StateChange& change);
absl::Status Delete(JobStore& store, const std::string& id);
absl::Status AddGainSets(JobStore& store, const std::vector<GainSet>& sets);
absl::Status DeleteGainSet(JobStore& store, const std::string& id);

// Creates a job with iterations 1..n as events 2..n + 1, without waiting for each.
void CreateWithIterations(JobStore& store, const std::string& id, int n);

// Empty, or what differs.
std::string Difference(const JobSpec& a, const JobSpec& b);
std::string Difference(const JobReport& a, const JobReport& b);
std::string Difference(const JobEvent& a, const JobEvent& b);
std::string Difference(const JobRecord& a, const JobRecord& b);
std::string Difference(const GainSet& a, const GainSet& b);

}  // namespace orbitune::storage_test
