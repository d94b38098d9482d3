// WatchJob, against a server in this process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

using ::testing::HasSubstr;

constexpr int kManyEvents = 20'000;

std::string NameOf(const std::string& id) { return "jobs/" + id; }

// A store that can hold back what its readers have read.
class GatedStore final : public JobStore {
 public:
  explicit GatedStore(JobStore& store) : store_(store) {}

  enum class Reads { kJobs, kEvents };

  // From now on such readers stop once they have read.
  void Close(Reads reads) {
    const std::lock_guard lock(mutex_);
    closed_ = reads;
  }
  void WaitForReader() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return held_back_ > 0; });
  }
  void Open() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = std::nullopt;
    }
    changed_.notify_all();
  }

  void CreateJob(std::string id, JobSpec spec, TimeUs now, std::string request_id, std::string digest,
                 Created done) override {
    store_.CreateJob(std::move(id), std::move(spec), now, std::move(request_id), std::move(digest), std::move(done));
  }
  void AppendIteration(const std::string& id, std::int64_t seq, const IterationRecord& record,
                       Continuation continuation, Done done) override {
    store_.AppendIteration(id, seq, record, std::move(continuation), std::move(done));
  }
  void ChangeState(const std::string& id, std::int64_t seq, StateChange change, Done done) override {
    store_.ChangeState(id, seq, std::move(change), std::move(done));
  }
  void DeleteJob(const std::string& id, Done done) override { store_.DeleteJob(id, std::move(done)); }
  absl::StatusOr<JobRecord> GetJob(const std::string& id) const override {
    auto job = store_.GetJob(id);
    Pass(Reads::kJobs);
    return job;
  }
  absl::StatusOr<std::vector<JobRecord>> ListJobs(const JobQuery& query) const override {
    return store_.ListJobs(query);
  }
  absl::StatusOr<std::vector<JobRecord>> ListUnfinishedJobs() const override { return store_.ListUnfinishedJobs(); }
  absl::StatusOr<std::vector<IterationRecord>> ListIterations(const std::string& id, int after,
                                                              int limit) const override {
    return store_.ListIterations(id, after, limit);
  }
  absl::StatusOr<std::vector<IterationRecord>> SampleIterations(const std::string& id, IterationRange range,
                                                                int max_points) const override {
    return store_.SampleIterations(id, range, max_points);
  }
  absl::StatusOr<std::vector<JobEvent>> ListEvents(const std::string& id, std::int64_t after,
                                                   int limit) const override {
    auto events = store_.ListEvents(id, after, limit);
    Pass(Reads::kEvents);
    return events;
  }
  CampaignStore& campaigns() override { return store_.campaigns(); }
  GainStore& gains() override { return store_.gains(); }
  RetentionStore& retention() override { return store_.retention(); }
  void Flush() override { store_.Flush(); }
  absl::Status ok_for_now() const override { return store_.ok_for_now(); }

 private:
  void Pass(Reads reads) const {
    std::unique_lock lock(mutex_);
    if (closed_ != reads) return;
    ++held_back_;
    changed_.notify_all();
    changed_.wait(lock, [&] { return closed_ != reads; });
    --held_back_;
  }

  JobStore& store_;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  // Guarded by mutex_.
  mutable int held_back_ = 0;
  std::optional<Reads> closed_;
};

class WatchTest : public RpcServerTest {
 protected:
  // Commits an event of a job that the scheduler does not know, and publishes it.
  void Commit(const std::string& id, std::int64_t seq, const StateChange& change) {
    engine_.store().ChangeState(id, seq, change, [this, id, seq, change](const absl::Status& status) {
      EXPECT_TRUE(status.ok()) << status;
      engine_.hub().Publish(id, {.seq = seq, .what = change});
      if (IsTerminal(change.state)) engine_.hub().Forget(id);
    });
  }
  void CommitIteration(const std::string& id, std::int64_t seq, int iteration) {
    const IterationRecord record{.iteration = iteration, .gains = {1, 1, 1, 1, 1}};
    engine_.store().AppendIteration(id, seq, record, {}, [this, id, seq, record](const absl::Status& status) {
      EXPECT_TRUE(status.ok()) << status;
      engine_.hub().Publish(id, {.seq = seq, .what = record});
    });
  }

  // A job of `kManyEvents` that is over before its watcher reads on; what the watcher then gets, batches taken apart.
  std::vector<v1::WatchJobResponse> WatchSlowly(v1::Delivery delivery, int iterations_per_message = 0);
};

StateChange StateOf(JobState state) { return {.state = state, .time_us = NowUs(), .message = {}, .report = {}}; }

// The seqs after the snapshot, each once: events', and those in gaps.
void ExpectAccountsFor(const std::vector<v1::WatchJobResponse>& events, std::int64_t first, std::int64_t last) {
  ASSERT_FALSE(events.empty());
  ASSERT_TRUE(events[0].has_snapshot());
  std::int64_t seq = first - 1;
  for (std::size_t i = 1; i < events.size(); ++i) {
    const v1::WatchJobResponse& event = events[i];
    ASSERT_FALSE(event.has_snapshot());
    if (event.has_gap()) {
      ASSERT_EQ(event.gap().first_seq(), seq + 1);
      ASSERT_GE(event.gap().last_seq(), event.gap().first_seq());
      ASSERT_EQ(event.seq(), event.gap().last_seq());
      seq = event.seq();
    } else {
      ASSERT_EQ(event.seq(), ++seq);
    }
  }
  EXPECT_EQ(seq, last);
}

// Messages with their batches taken apart, which have at most `most` iterations.
std::vector<v1::WatchJobResponse> TakenApart(const std::vector<v1::WatchJobResponse>& messages, int most) {
  std::vector<v1::WatchJobResponse> events;
  for (const v1::WatchJobResponse& message : messages) {
    if (!message.has_iteration_batch()) {
      events.push_back(message);
      continue;
    }
    const int iterations = message.iteration_batch().iterations_size();
    EXPECT_GE(iterations, 2);
    EXPECT_LE(iterations, most);
    for (int i = 0; i < iterations; ++i) {
      v1::WatchJobResponse& event = events.emplace_back();
      event.set_seq(message.seq() - iterations + 1 + i);
      *event.mutable_iteration() = message.iteration_batch().iterations(i);
    }
  }
  return events;
}

v1::ListIterationsResponse IterationsIn(const std::vector<v1::WatchJobResponse>& events) {
  v1::ListIterationsResponse iterations;
  for (const auto& event : events) {
    if (event.has_iteration()) *iterations.add_iterations() = event.iteration();
  }
  return iterations;
}

TEST_F(WatchTest, EveryEventOnceInOrderAndOnDiskBeforeItIsTold) {
  const std::string name = client_->Create(60);
  const std::string id = name.substr(5);
  Watch watch(*client_, name);
  std::vector<v1::WatchJobResponse> events;
  v1::WatchJobResponse event;
  while (watch.Read(&event)) {
    events.push_back(event);
    ASSERT_GE(engine_.Get(id).last_seq, event.seq());
  }
  const grpc::Status status = watch.Finish();
  EXPECT_TRUE(status.ok()) << status.error_message();
  ExpectAccountsFor(events, 1, 63);  // QUEUED, RUNNING, 60 iterations, SUCCEEDED
  EXPECT_EQ(IterationsIn(events).SerializeAsString(), client_->Iterations(name).SerializeAsString());
  const v1::StateChange& end = events.back().state_change();
  EXPECT_EQ(end.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(end.report().SerializeAsString(), client_->Get(name).report().SerializeAsString());
}

TEST_F(WatchTest, AJobThatHasEndedIsReadFromTheStore) {
  const std::string name = client_->Create(600);  // more than the hub keeps, and a read of the store takes
  client_->WaitForEnd(name);
  for (const auto delivery : {v1::DELIVERY_UNSPECIFIED, v1::DELIVERY_EVERY}) {
    grpc::Status status;
    const auto events = Watch(*client_, name, 0, delivery).ReadAll(&status);
    EXPECT_TRUE(status.ok()) << status.error_message();
    ExpectAccountsFor(events, 1, 603);
    EXPECT_EQ(events[0].seq(), 603);
    EXPECT_EQ(events[0].snapshot().SerializeAsString(), client_->Get(name).SerializeAsString());
    EXPECT_EQ(IterationsIn(events).SerializeAsString(), client_->Iterations(name).SerializeAsString());
  }
}

std::vector<v1::WatchJobResponse> WatchInBatches(Client& client, const std::string& name, int most,
                                                 std::int64_t after = 0) {
  grpc::Status status;
  auto messages = Watch(client, name, after, v1::DELIVERY_EVERY, most).ReadAll(&status);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return messages;
}

TEST_F(WatchTest, IterationsComeInBatchesWhereTheWatcherAsksForThem) {
  const std::string name = client_->Create(600);
  const auto live = WatchInBatches(*client_, name, 50);
  EXPECT_LT(live.size(), 300u);
  ExpectAccountsFor(TakenApart(live, 50), 1, 603);
  EXPECT_EQ(IterationsIn(TakenApart(live, 50)).SerializeAsString(), client_->Iterations(name).SerializeAsString());
  for (const int most : {0, 1, 2, 100, 256}) {
    for (const std::int64_t after : {0, 300}) {  // 300: amid a batch
      const auto messages = WatchInBatches(*client_, name, most, after);
      ExpectAccountsFor(TakenApart(messages, most), after + 1, 603);
      // The ends of what is read at a time are seams, too.
      EXPECT_LE(messages.size(), static_cast<std::size_t>(most < 2 ? 604 - after : (604 - after) / most + 10));
    }
  }
  grpc::Status status;
  const auto latest = Watch(*client_, name, 0, v1::DELIVERY_LATEST, 256).ReadAll(&status);
  EXPECT_TRUE(status.ok()) << status.error_message();
  for (const auto& message : latest) EXPECT_FALSE(message.has_iteration_batch());
}

TEST_F(WatchTest, ABatchEndsWhereTheJobsStateChanges) {
  StoreJob(engine_.store(), "manual", SpecOf(SmallScenario()));
  std::int64_t seq = 1;
  int iteration = 0;
  std::size_t count = 2;  // the snapshot, and the creation
  for (int i = 0; i < 30; ++i) {
    Commit("manual", ++seq, StateOf(JobState::kRunning));
    for (int k = 0; k < i % 4; ++k) CommitIteration("manual", ++seq, ++iteration);
    Commit("manual", ++seq, StateOf(JobState::kPaused));
    Commit("manual", ++seq, StateOf(JobState::kQueued));
    count += i % 4 == 0 ? 3 : 4;
  }
  Commit("manual", ++seq, StateOf(JobState::kCancelled));
  ++count;
  engine_.store().Flush();
  const auto messages = WatchInBatches(*client_, NameOf("manual"), 256);
  EXPECT_EQ(messages.size(), count);
  const auto events = TakenApart(messages, 256);
  ExpectAccountsFor(events, 1, seq);
  grpc::Status status;
  const auto alone = Watch(*client_, NameOf("manual")).ReadAll(&status);
  ASSERT_EQ(events.size(), alone.size());
  for (std::size_t i = 1; i < alone.size(); ++i) {
    EXPECT_EQ(events[i].SerializeAsString(), alone[i].SerializeAsString());
  }
}

TEST_F(WatchTest, ResumesWhereItIsTold) {
  const std::string name = client_->Create(20);
  client_->WaitForEnd(name);
  grpc::Status status;
  for (const std::int64_t after : {1, 2, 12, 22}) {
    const auto events = Watch(*client_, name, after).ReadAll(&status);
    EXPECT_TRUE(status.ok()) << status.error_message();
    ExpectAccountsFor(events, after + 1, 23);
  }
  for (const std::int64_t after : {23, -1}) {
    const auto events = Watch(*client_, name, after).ReadAll(&status);
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(events.size(), 1u);  // the snapshot
  }
}

TEST_F(WatchTest, FromNowOnIsOnlyWhatIsNew) {
  StoreJob(engine_.store(), "manual", SpecOf(SmallScenario()));
  Watch watch(*client_, NameOf("manual"), -1);
  v1::WatchJobResponse event;
  ASSERT_TRUE(watch.Read(&event));
  EXPECT_EQ(event.snapshot().last_seq(), 1);
  Commit("manual", 2, StateOf(JobState::kRunning));
  CommitIteration("manual", 3, 1);
  Commit("manual", 4, StateOf(JobState::kCancelled));
  std::vector<std::int64_t> seqs;
  while (watch.Read(&event)) seqs.push_back(event.seq());
  EXPECT_THAT(seqs, ::testing::ElementsAre(2, 3, 4));
  EXPECT_TRUE(watch.Finish().ok());
}

TEST_F(WatchTest, WhatCannotBeWatchedIsRefused) {
  const std::string name = client_->Create(3);
  client_->WaitForEnd(name);
  grpc::Status status;
  for (const std::int64_t after : {std::int64_t{7}, std::int64_t{-2}, std::int64_t{1} << 62}) {
    EXPECT_TRUE(Watch(*client_, name, after).ReadAll(&status).empty());
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    const ErrorDetails details = DetailsOf(status);
    ASSERT_EQ(details.violations.size(), 1u);
    EXPECT_EQ(details.violations[0].field(), "resume_after_seq");
    EXPECT_THAT(details.violations[0].description(), HasSubstr("in [-1, 6]"));
  }
  for (const int most : {-1, 257}) {
    EXPECT_TRUE(Watch(*client_, name, 0, v1::DELIVERY_EVERY, most).ReadAll(&status).empty());
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_EQ(DetailsOf(status).violations.at(0).field(), "max_iterations_per_message");
    EXPECT_THAT(DetailsOf(status).violations.at(0).description(), HasSubstr("in [0, 256]"));
  }
  Watch(*client_, name, 0, static_cast<v1::Delivery>(9)).ReadAll(&status);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  Watch(*client_, "jobs/none").ReadAll(&status);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  Watch(*client_, "none").ReadAll(&status);
  EXPECT_EQ(DetailsOf(status).violations.at(0).field(), "name");
  Watch(*client_, "jobs/" + std::string(10 << 20, 'x')).ReadAll(&status);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND) << status.error_message();
}

TEST_F(WatchTest, PausesAndResumesAreEvents) {
  const std::string name = client_->Create(SearchOptions::kMaxIterations);
  Watch watch(*client_, name);
  client_->WaitForIterations(name, 2);
  EXPECT_TRUE(client_->Transition(&v1::TuningService::Stub::PauseJob, name).ok());
  EXPECT_TRUE(client_->Transition(&v1::TuningService::Stub::ResumeJob, name).ok());
  EXPECT_TRUE(client_->Cancel(name).ok());
  grpc::Status status;
  const auto events = watch.ReadAll(&status);
  EXPECT_TRUE(status.ok()) << status.error_message();
  ExpectAccountsFor(events, 1, client_->Get(name).last_seq());
  std::vector<v1::JobState> states;
  for (const auto& event : events) {
    if (event.has_state_change()) states.push_back(event.state_change().state());
  }
  EXPECT_THAT(states, ::testing::ElementsAre(v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_PAUSED,
                                             v1::JOB_STATE_QUEUED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_CANCELLED));
}

std::vector<v1::WatchJobResponse> WatchTest::WatchSlowly(v1::Delivery delivery, int iterations_per_message) {
  StoreJob(engine_.store(), "manual", SpecOf(EndlessScenario()));
  // What the transport holds for a reader is kept small.
  grpc::ChannelArguments narrow;
  narrow.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  narrow.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 16 << 10);
  Client client(server_->address(), narrow);
  Watch watch(client, NameOf("manual"), 0, delivery, iterations_per_message);
  std::vector<v1::WatchJobResponse> events(1);
  EXPECT_TRUE(watch.Read(&events[0]));
  Commit("manual", 2, StateOf(JobState::kRunning));
  std::int64_t seq = 2;
  for (int i = 1; i <= kManyEvents; ++i) CommitIteration("manual", ++seq, i);
  engine_.store().Flush();
  // Another watcher is not held up by this one.
  grpc::Status status;
  Commit("manual", ++seq, StateOf(JobState::kCancelled));
  EXPECT_TRUE(Watch(*client_, NameOf("manual"), seq - 10).ReadAll(&status).back().has_state_change());
  const auto rest = TakenApart(watch.ReadAll(&status), iterations_per_message);
  EXPECT_TRUE(status.ok()) << status.error_message();
  events.insert(events.end(), rest.begin(), rest.end());
  ExpectAccountsFor(events, 1, seq);
  EXPECT_EQ(events.back().state_change().state(), v1::JOB_STATE_CANCELLED);
  EXPECT_EQ(events[events.size() - 2].iteration().iteration(), kManyEvents) << "the newest iteration was left out";
  return events;
}

TEST_F(WatchTest, ASlowReaderOfEveryMissesNothing) {
  EXPECT_EQ(WatchSlowly(v1::DELIVERY_EVERY).size(), kManyEvents + 4u);
}

TEST_F(WatchTest, ASlowReaderOfBatchesMissesNothing) {
  EXPECT_EQ(WatchSlowly(v1::DELIVERY_EVERY, 256).size(), kManyEvents + 4u);
}

TEST_F(WatchTest, ASlowReaderOfTheLatestIsToldItsGaps) {
  const auto events = WatchSlowly(v1::DELIVERY_LATEST);
  EXPECT_LT(events.size(), kManyEvents / 2u);
  const auto gaps = std::count_if(events.begin(), events.end(), [](const auto& event) { return event.has_gap(); });
  EXPECT_GE(gaps, 1);
}

TEST_F(WatchTest, AHundredWatchersSomeOfWhichLeave) {
  const std::string name = client_->Create(100);
  std::vector<std::thread> watchers;
  std::atomic<int> whole = 0;
  for (int i = 0; i < 100; ++i) {
    watchers.emplace_back([&, i] {
      const bool leaves = i % 3 == 0;
      const bool latest = i % 3 == 1;
      Watch watch(*client_, name, 0, latest ? v1::DELIVERY_LATEST : v1::DELIVERY_EVERY);
      v1::WatchJobResponse event;
      if (leaves) {
        for (int read = 0; read < i / 3 && watch.Read(&event); ++read) {
        }
        return;  // cancels
      }
      grpc::Status status;
      const auto events = watch.ReadAll(&status);
      EXPECT_TRUE(status.ok()) << status.error_message();
      ExpectAccountsFor(events, 1, 103);
      ++whole;
    });
  }
  for (std::thread& watcher : watchers) watcher.join();
  EXPECT_EQ(whole, 66);
  EXPECT_EQ(client_->WaitForEnd(name).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(WatchTest, WatchersOfShortJobsAllSeeTheEnd) {
  for (int round = 0; round < 25; ++round) {
    const std::string name = client_->Create(1 + round % 4);
    std::vector<std::thread> watchers;
    for (int i = 0; i < 4; ++i) {
      watchers.emplace_back([&, i] {
        Watch watch(*client_, name, 0, i % 2 == 0 ? v1::DELIVERY_EVERY : v1::DELIVERY_LATEST);
        if (i == 3) return watch.Cancel();
        grpc::Status status;
        const auto events = watch.ReadAll(&status);
        EXPECT_TRUE(status.ok()) << status.error_message();
        ExpectAccountsFor(events, 1, 4 + round % 4);
      });
    }
    for (std::thread& watcher : watchers) watcher.join();
  }
}

TEST_F(WatchTest, ADrainEndsWatchersWithUnavailable) {
  const std::string name = client_->Create(SearchOptions::kMaxIterations);
  client_->WaitForIterations(name, 3);
  Watch reading(*client_, name);
  Watch latest(*client_, name, -1, v1::DELIVERY_LATEST);
  v1::WatchJobResponse event;
  ASSERT_TRUE(latest.Read(&event));
  ASSERT_TRUE(reading.Read(&event));
  std::thread drain([&] { server_->Shutdown(std::chrono::seconds(5)); });
  for (Watch* watch : {&reading, &latest}) {
    grpc::Status status;
    const auto events = watch->ReadAll(&status);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
    EXPECT_TRUE(DetailsOf(status).retry);
    if (watch == &reading) {
      const auto stored = engine_.Events(name.substr(5));
      ASSERT_LE(events.size(), stored.size());
      for (std::size_t i = 0; i < events.size(); ++i) EXPECT_EQ(events[i].seq(), stored[i].seq);
    }
  }
  drain.join();
}

// With a store whose reads take as long as the test wants.
class SlowStoreTest : public WatchTest {
 protected:
  ~SlowStoreTest() override {
    gated_.Open();
    slow_server_->Shutdown(std::chrono::seconds(2));
  }

  GatedStore gated_{engine_.store()};
  UseCases use_cases_{gated_, engine_.scheduler(), engine_.hub()};
  Api slow_api_{use_cases_, engine_.campaigns(), engine_.gains()};
  const std::unique_ptr<RpcServer> slow_server_ = StartRpcServer(slow_api_);
  const std::unique_ptr<Client> slow_client_ = std::make_unique<Client>(slow_server_->address());
};

// The hub lets go of a job's end at once: a watcher that was reading the store when it came must read again.
TEST_F(SlowStoreTest, AnEndThatComesDuringAReadIsNotMissed) {
  for (const v1::Delivery delivery : {v1::DELIVERY_EVERY, v1::DELIVERY_LATEST}) {
    const std::string id = "manual" + std::to_string(delivery);
    StoreRunningJob(engine_.store(), id, SpecOf(SmallScenario()), {});
    gated_.Close(GatedStore::Reads::kEvents);
    Watch watch(*slow_client_, NameOf(id), 0, delivery);
    gated_.WaitForReader();  // it has read events 1 and 2
    Commit(id, 3, StateOf(JobState::kCancelled));
    engine_.store().Flush();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));  // for its wake
    gated_.Open();
    grpc::Status status;
    const auto events = watch.ReadAll(&status);
    EXPECT_TRUE(status.ok()) << status.error_message();
    ExpectAccountsFor(events, 1, 3);
  }
}

TEST_F(SlowStoreTest, AWatcherThatLeavesWhileItsSnapshotIsReadLeavesNothingBehind) {
  StoreRunningJob(engine_.store(), "manual", SpecOf(SmallScenario()), {});
  for (int round = 0; round < 10; ++round) {
    gated_.Close(GatedStore::Reads::kJobs);
    {
      Watch watch(*slow_client_, NameOf("manual"));
      gated_.WaitForReader();
    }  // cancels, and sees it ended
    CommitIteration("manual", 3 + round, 1 + round);
    gated_.Open();
    engine_.store().Flush();
  }
  Commit("manual", 13, StateOf(JobState::kCancelled));
  grpc::Status status;
  EXPECT_EQ(Watch(*slow_client_, NameOf("manual")).ReadAll(&status).size(), 14u);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

}  // namespace
}  // namespace orbitune::server_test
