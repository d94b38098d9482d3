#include "storage/sqlite_writer.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"

namespace orbitune {
namespace {

constexpr std::size_t kLargestGroup = 1024;
constexpr std::chrono::milliseconds kLongestPause{2000};
// From one group to the next where they are gathered, unless there are enough for a commit before.
constexpr std::chrono::milliseconds kGathering{24};
constexpr std::size_t kEnough = 256;

// A status of its own for each (see SqliteWriter::Operation::answer).
std::vector<absl::Status> GiveUp(std::size_t operations, const absl::Status& trouble) {
  std::vector<absl::Status> results;
  for (std::size_t i = 0; i < operations; ++i) {
    results.push_back(
        absl::UnavailableError(absl::StrCat("the store was closed while it could not write: ", trouble.message())));
  }
  return results;
}

}  // namespace

SqliteWriter::SqliteWriter(Connection& connection, std::chrono::milliseconds first_pause, StoreMetrics* metrics)
    : connection_(connection), tables_(connection), first_pause_(first_pause), metrics_(metrics), thread_([this] {
        Run();
      }) {}

SqliteWriter::~SqliteWriter() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  work_.notify_all();
  thread_.join();
}

void SqliteWriter::Queue(Operation operation) {
  bool news = false;
  {
    const std::lock_guard lock(mutex_);
    pressing_ = pressing_ || !operation.can_wait;
    news = !operation.can_wait || queue_.empty() || queue_.size() + 1 == kEnough;
    queue_.push_back(std::move(operation));
    ++queued_count_;
  }
  if (news) work_.notify_one();
}

void SqliteWriter::Flush() {
  std::unique_lock lock(mutex_);
  pressing_ = !queue_.empty();
  work_.notify_one();
  answered_.wait(lock, [this, all = queued_count_] { return answered_count_ >= all; });
}

absl::Status SqliteWriter::trouble() const {
  const std::lock_guard lock(mutex_);
  return trouble_.empty() ? absl::OkStatus() : absl::UnavailableError(trouble_);
}

bool SqliteWriter::stopping() const {
  const std::lock_guard lock(mutex_);
  return stopping_;
}

void SqliteWriter::SetTrouble(std::string reason) {
  const std::lock_guard lock(mutex_);
  trouble_ = std::move(reason);
}

void SqliteWriter::PauseBeforeRetry(std::chrono::milliseconds pause) {
  std::unique_lock lock(mutex_);
  work_.wait_for(lock, pause, [this] { return stopping_; });
}

void SqliteWriter::Run() {
  std::vector<Operation> group;
  while (TakeGroup(group)) {
    if (group.empty()) {
      RemoveLeftovers();
    } else {
      const auto begun = std::chrono::steady_clock::now();
      std::vector<absl::Status> results = Commit(group);
      Count(group.size(), std::chrono::steady_clock::now() - begun);
      for (std::size_t i = 0; i < group.size(); ++i) {
        if (group[i].answer) group[i].answer(std::move(results[i]));
      }
      group.clear();
      CountAnswered(results.size());
    }
  }
}

void SqliteWriter::Gather(std::unique_lock<std::mutex>& lock) {
  if (last_group_ < 2) return;  // whoever queued it may wait for it before the next
  work_.wait_until(lock, last_taken_ + kGathering,
                   [this] { return pressing_ || stopping_ || queue_.size() >= kEnough; });
}

bool SqliteWriter::TakeGroup(std::vector<Operation>& group) {
  group.clear();
  std::unique_lock lock(mutex_);
  const auto wanted = [this] { return stopping_ || !queue_.empty(); };
  if (!leftovers_) {
    work_.wait(lock, wanted);
  } else if (leftovers_hit_) {
    work_.wait_for(lock, kLongestPause, wanted);
  }
  if (stopping_ && queue_.empty()) return false;
  if (!queue_.empty()) Gather(lock);
  while (!queue_.empty() && group.size() < kLargestGroup) {
    group.push_back(std::move(queue_.front()));
    queue_.pop_front();
  }
  pressing_ = pressing_ && !queue_.empty();
  last_group_ = group.size();
  last_taken_ = std::chrono::steady_clock::now();
  return true;
}

void SqliteWriter::Count(std::size_t operations, std::chrono::duration<double> taken) {
  if (metrics_ == nullptr) return;
  metrics_->commit_s.Observe(taken.count());
  metrics_->group_size.Observe(static_cast<double>(operations));
}

void SqliteWriter::CountAnswered(std::size_t answered) {
  {
    const std::lock_guard lock(mutex_);
    answered_count_ += answered;
  }
  answered_.notify_all();
}

std::vector<absl::Status> SqliteWriter::Commit(std::span<Operation> group) {
  if (gave_up_) return GiveUp(group.size(), trouble());
  for (auto pause = first_pause_;; pause = std::min(2 * pause, kLongestPause)) {
    const bool last_try = stopping();
    absl::StatusOr<std::vector<absl::Status>> results = TryCommit(group);
    if (results.ok()) {
      SetTrouble("");
      return *std::move(results);
    }
    if (!absl::IsUnavailable(results.status())) {
      return group.size() == 1 ? std::vector{results.status()} : CommitOneByOne(group);
    }
    SetTrouble(std::string(results.status().message()));
    if (last_try) {
      gave_up_ = true;
      return GiveUp(group.size(), trouble());
    }
    Refuse(group);
    PauseBeforeRetry(pause);
  }
}

void SqliteWriter::Refuse(std::span<Operation> group) {
  std::vector<std::function<void(absl::Status)>> answers;
  const auto take = [&answers](Operation& operation) {
    if (!operation.refusable || !operation.answer) return;
    answers.push_back(std::exchange(operation.answer, nullptr));
    operation.apply = [](JobTables&) { return absl::OkStatus(); };
  };
  for (Operation& operation : group) take(operation);
  std::string reason;
  {
    const std::lock_guard lock(mutex_);
    for (Operation& operation : queue_) take(operation);
    reason = trouble_;
  }
  for (const auto& answer : answers) answer(absl::UnavailableError(absl::StrCat("the disk fails: ", reason)));
}

std::vector<absl::Status> SqliteWriter::CommitOneByOne(std::span<Operation> group) {
  std::vector<absl::Status> results;
  for (std::size_t i = 0; i < group.size(); ++i) results.push_back(Commit(group.subspan(i, 1)).front());
  return results;
}

absl::StatusOr<std::vector<absl::Status>> SqliteWriter::TryCommit(std::span<const Operation> group) {
  tables_.Forget();
  auto transaction = Transaction::Begin(connection_, Transaction::Kind::kWrite);
  if (!transaction.ok()) return transaction.status();
  std::vector<absl::Status> results;
  results.reserve(group.size());
  const std::int64_t failures = connection_.failures();
  for (const Operation& operation : group) {
    results.push_back(operation.apply(tables_));
    if (connection_.failures() != failures) {
      ORBITUNE_CHECK(!results.back().ok());
      return results.back();
    }
  }
  absl::Status status = tables_.WriteProgress();
  if (status.ok()) status = transaction->Commit();
  if (!status.ok()) return status;
  leftovers_ = leftovers_ || tables_.deleted_any();
  return results;
}

void SqliteWriter::RemoveLeftovers() {
  tables_.Forget();
  auto transaction = Transaction::Begin(connection_, Transaction::Kind::kWrite);
  absl::StatusOr<bool> more = transaction.ok() ? tables_.RemoveLeftovers() : transaction.status();
  if (more.ok() && *more) {
    if (absl::Status status = transaction->Commit(); !status.ok()) more = status;
  }
  leftovers_hit_ = !more.ok();
  leftovers_ = !more.ok() || *more;
}

}  // namespace orbitune
