#include "server/jobs/retention.h"

#include <chrono>
#include <filesystem>
#include <future>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "storage/sqlite_backup.h"

namespace orbitune {
namespace {

constexpr std::chrono::minutes kBetweenPasses(1);
constexpr int kAtOnce = 100;
// By size, a few, and then a look at what that brought.
constexpr int kFew = 8;
constexpr std::chrono::milliseconds kBetweenLooks(50);

TimeUs Before(TimeUs now, double days) { return now - static_cast<TimeUs>(days * 86'400e6); }

absl::Status Await(const std::function<void(JobStore::Done)>& call) {
  std::promise<absl::Status> answer;
  call([&answer](absl::Status status) { answer.set_value(std::move(status)); });
  return answer.get_future().get();
}

}  // namespace

Retention::Retention(JobStore& store, CampaignEngine& campaigns, std::string database, const RetentionPolicy& policy,
                     Log log)
    : store_(store), campaigns_(campaigns), database_(std::move(database)), policy_(policy), log_(std::move(log)) {}

void Retention::Start() {
  if (policy_.off()) return;
  thread_ = std::thread([this] {
    do {
      Pass(NowUs());
    } while (!WaitOrStop(kBetweenPasses));
  });
}

void Retention::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool Retention::WaitOrStop(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex_);
  return stop_.wait_for(lock, time, [this] { return stopping_; });
}

bool Retention::stopping() { return WaitOrStop(std::chrono::milliseconds(0)); }

void Retention::Pass(TimeUs now) {
  absl::Status status = RemoveByAge(now);
  if (status.ok() && policy_.max_database_bytes > 0) status = RemoveBySize();
  if (policy_.backups_days > 0) RemoveBackups(now);
  // While the disk fails nothing can be removed; that is told elsewhere.
  if (!status.ok() && !absl::IsUnavailable(status)) {
    log_(absl::StrCat("retention: ", std::string(status.message())));
  }
}

absl::Status Retention::RemoveByAge(TimeUs now) {
  const RetentionStore& old = store_.retention();
  absl::Status status;
  if (policy_.iterations_days > 0) {
    const TimeUs before = Before(now, policy_.iterations_days);
    status = RemoveAll(
        "the iterations of jobs", [&](int limit) { return old.HistoriesEndedBefore(before, limit); },
        [this](const std::string& id) { return RemoveIterations(id); });
  }
  if (status.ok() && policy_.jobs_days > 0) {
    const TimeUs before = Before(now, policy_.jobs_days);
    status = RemoveAll(
        "jobs", [&](int limit) { return old.JobsEndedBefore(before, limit); },
        [this](const std::string& id) { return RemoveJob(id); });
  }
  if (status.ok() && policy_.campaigns_days > 0) {
    const TimeUs before = Before(now, policy_.campaigns_days);
    status = RemoveAll(
        "campaigns", [&](int limit) { return old.CampaignsEndedBefore(before, limit); },
        [this](const std::string& id) { return campaigns_.Delete(id, ""); });
  }
  return status;
}

absl::Status Retention::RemoveAll(const std::string& what, const List& list, const Remove& remove) {
  while (!stopping()) {
    const absl::StatusOr<int> removed = RemoveSome(what, list, remove, kAtOnce);
    if (!removed.ok()) return removed.status();
    if (*removed == 0) return absl::OkStatus();
  }
  return absl::OkStatus();
}

absl::StatusOr<int> Retention::RemoveSome(const std::string& what, const List& list, const Remove& remove, int limit) {
  const auto ended = list(limit);
  if (!ended.ok()) return ended.status();
  int removed = 0;
  std::string names;
  absl::Status status;
  for (const Ended& one : *ended) {
    if (stopping()) break;
    status = remove(one.id);
    if (absl::IsUnavailable(status)) break;
    // Gone meanwhile, or begun again.
    if (!status.ok()) continue;
    ++removed;
    absl::StrAppend(&names, removed == 1 ? "" : ", ", one.id);
  }
  if (removed > 0) log_(absl::StrCat("retention: removed ", what, " ", names));
  if (absl::IsUnavailable(status)) return status;
  return removed;
}

absl::Status Retention::RemoveBySize() {
  while (!stopping()) {
    const auto usage = store_.retention().GetUsage();
    if (!usage.ok()) return usage.status();
    if (usage->bytes <= policy_.max_database_bytes) {
      told_that_full_ = false;
      return absl::OkStatus();
    }
    if (usage->removing) {
      WaitOrStop(kBetweenLooks);
      continue;
    }
    const absl::StatusOr<int> removed = RemoveOldest();
    if (!removed.ok()) return removed.status();
    if (*removed > 0) continue;
    if (!std::exchange(told_that_full_, true)) {
      log_(absl::StrCat("retention: the database has ", usage->bytes, " bytes in use, more than the ",
                        policy_.max_database_bytes, " allowed, and nothing is left that may be removed"));
    }
    return absl::OkStatus();
  }
  return absl::OkStatus();
}

absl::StatusOr<int> Retention::RemoveOldest() {
  const RetentionStore& old = store_.retention();
  constexpr TimeUs kAny = std::numeric_limits<TimeUs>::max();
  const auto histories = RemoveSome(
      "the iterations of jobs", [&](int limit) { return old.HistoriesEndedBefore(kAny, limit); },
      [this](const std::string& id) { return RemoveIterations(id); }, kFew);
  if (!histories.ok() || *histories > 0) return histories;
  const auto jobs = old.JobsEndedBefore(kAny, 1);
  const auto campaigns = old.CampaignsEndedBefore(kAny, 1);
  if (!jobs.ok()) return jobs.status();
  if (!campaigns.ok()) return campaigns.status();
  const bool campaign_first =
      jobs->empty() || (!campaigns->empty() && campaigns->front().end_time_us < jobs->front().end_time_us);
  if (campaign_first) {
    return RemoveSome(
        "campaigns", [&](int limit) { return old.CampaignsEndedBefore(kAny, limit); },
        [this](const std::string& id) { return campaigns_.Delete(id, ""); }, 1);
  }
  const TimeUs until = campaigns->empty() ? kAny : campaigns->front().end_time_us + 1;
  return RemoveSome(
      "jobs", [&](int limit) { return old.JobsEndedBefore(until, limit); },
      [this](const std::string& id) { return RemoveJob(id); }, kFew);
}

void Retention::RemoveBackups(TimeUs now) {
  auto backups = MigrationBackupsBeside(database_);
  if (!backups.empty()) backups.pop_back();
  const auto oldest =
      std::chrono::file_clock::now() - std::chrono::microseconds(now - Before(now, policy_.backups_days));
  for (const std::string& path : backups) {
    std::error_code error;
    if (std::filesystem::last_write_time(path, error) >= oldest || error) continue;
    if (std::filesystem::remove(path, error)) log_(absl::StrCat("retention: removed the backup ", path));
  }
}

absl::Status Retention::RemoveJob(const std::string& id) {
  return Await([&](JobStore::Done done) { store_.DeleteJob(id, std::move(done)); });
}

absl::Status Retention::RemoveIterations(const std::string& id) {
  return Await([&](JobStore::Done done) { store_.retention().RemoveIterations(id, NowUs(), std::move(done)); });
}

}  // namespace orbitune
