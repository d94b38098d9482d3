#include "tests/bench/job_bench.h"

#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <mutex>
#include <thread>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/scenario/presets.h"
#include "orbitune/v1/tuning.grpc.pb.h"
#include "server/jobs/scheduler.h"
#include "server/rpc/server.h"
#include "storage/sqlite_store.h"
#include "tests/bench/median.h"

namespace orbitune::bench {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

JobRow Row(std::string what, int jobs, int threads, int iterations, double seconds, double reduction) {
  return {std::move(what), jobs, threads, iterations, seconds, jobs * iterations / seconds, reduction};
}

// A store that forgets: acknowledges every write on a thread of its own, as a store must, and keeps nothing.
class NullStore final : public JobStore {
 public:
  // on_end: told of every change to a state that ends a job, on the caller's thread.
  explicit NullStore(std::function<void(const StateChange&)> on_end)
      : on_end_(std::move(on_end)), thread_([this] { Loop(); }) {}
  ~NullStore() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  void CreateJob(std::string, JobSpec, TimeUs, std::string, std::string, Created) override { ORBITUNE_CHECK(false); }
  void AppendIteration(const std::string&, std::int64_t, const IterationRecord&, Continuation, Done done) override {
    Answer(std::move(done));
  }
  void ChangeState(const std::string&, std::int64_t, StateChange change, Done done) override {
    if (IsTerminal(change.state)) on_end_(change);
    Answer(std::move(done));
  }
  void DeleteJob(const std::string&, Done done) override { Answer(std::move(done)); }
  absl::StatusOr<JobRecord> GetJob(const std::string&) const override { return absl::NotFoundError(""); }
  absl::StatusOr<std::vector<JobRecord>> ListJobs(const JobQuery&) const override { return std::vector<JobRecord>(); }
  absl::StatusOr<std::vector<JobRecord>> ListUnfinishedJobs() const override { return std::vector<JobRecord>(); }
  absl::StatusOr<std::vector<IterationRecord>> ListIterations(const std::string&, int, int) const override {
    return std::vector<IterationRecord>();
  }
  absl::StatusOr<std::vector<IterationRecord>> SampleIterations(const std::string&, IterationRange,
                                                                int) const override {
    return std::vector<IterationRecord>();
  }
  absl::StatusOr<std::vector<JobEvent>> ListEvents(const std::string&, std::int64_t, int) const override {
    return std::vector<JobEvent>();
  }
  // There are none.
  CampaignStore& campaigns() override { std::abort(); }
  GainStore& gains() override { std::abort(); }
  RetentionStore& retention() override { std::abort(); }
  void Flush() override {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return waiting_.empty() && !answering_; });
  }
  absl::Status ok_for_now() const override { return absl::OkStatus(); }

 private:
  void Answer(Done done) {
    {
      const std::lock_guard lock(mutex_);
      waiting_.push_back(std::move(done));
    }
    changed_.notify_all();
  }

  void Loop() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return ending_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      std::deque<Done> taken = std::exchange(waiting_, {});
      answering_ = true;
      lock.unlock();
      for (const Done& done : taken) {
        if (done) done(absl::OkStatus());
      }
      lock.lock();
      answering_ = false;
      changed_.notify_all();
    }
  }

  const std::function<void(const StateChange&)> on_end_;
  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::deque<Done> waiting_;
  bool answering_ = false;
  bool ending_ = false;
  std::thread thread_;
};

// Creates the job of one seed, watches it to its end, and returns its cost reduction in percent.
double RunOne(v1::TuningService::Stub& stub, std::uint64_t seed, int iterations, int iterations_per_message) {
  v1::CreateJobRequest create;
  create.mutable_job()->set_scenario("scenarios/gto-geo");
  create.mutable_job()->mutable_hyperparameters()->set_seed(seed);
  create.mutable_job()->mutable_hyperparameters()->set_iterations(iterations);
  v1::Job job;
  grpc::ClientContext create_context;
  ORBITUNE_CHECK(stub.CreateJob(&create_context, create, &job).ok());
  v1::WatchJobRequest watch;
  watch.set_name(job.name());
  watch.set_max_iterations_per_message(iterations_per_message);
  grpc::ClientContext context;
  const auto reader = stub.WatchJob(&context, watch);
  v1::WatchJobResponse event;
  int seen = 0;
  double reduction = 0;
  while (reader->Read(&event)) {
    if (event.has_iteration()) ORBITUNE_CHECK(event.iteration().iteration() == ++seen);
    for (const v1::Iteration& iteration : event.iteration_batch().iterations()) {
      ORBITUNE_CHECK(iteration.iteration() == ++seen);
    }
    if (event.has_state_change() && event.state_change().has_report()) {
      reduction = event.state_change().report().final_reduction().cost_percent();
    }
  }
  ORBITUNE_CHECK(reader->Finish().ok() && seen == iterations);
  return reduction;
}

}  // namespace

JobRow RunThroughServer(int jobs, int threads, int iterations, int iterations_per_message) {
  const auto folder = std::filesystem::temp_directory_path() / absl::StrCat("orbitune_bench_", getpid());
  std::filesystem::create_directories(folder);
  JobRow row;
  {
    auto store = OpenSqliteStore({.path = (folder / "orbitune.db").string()});
    ORBITUNE_CHECK(store.ok());
    EventHub hub;
    Scheduler scheduler(**store, hub, {.threads = threads});
    UseCases use_cases(**store, scheduler, hub);
    CampaignEngine campaigns(**store, (*store)->campaigns(), scheduler, hub);
    CampaignUseCases campaign_use_cases(use_cases, (*store)->campaigns(), campaigns);
    ORBITUNE_CHECK(scheduler.Start().ok());
    GainLibrary library;
    GainUseCases gains(**store, library);
    Api api(use_cases, campaign_use_cases, gains);
    auto server = RpcServer::Start("127.0.0.1:0", api);
    ORBITUNE_CHECK(server.ok());
    const auto stub =
        v1::TuningService::NewStub(grpc::CreateChannel((*server)->address(), grpc::InsecureChannelCredentials()));
    std::vector<double> reductions(static_cast<std::size_t>(jobs));
    RunOne(*stub, 1, 1, iterations_per_message);
    const auto begin = Clock::now();
    std::vector<std::thread> clients;
    for (std::size_t j = 0; j < reductions.size(); ++j) {
      clients.emplace_back([&, j] { reductions[j] = RunOne(*stub, j + 1, iterations, iterations_per_message); });
    }
    for (std::thread& client : clients) client.join();
    row = Row("server", jobs, threads, iterations, SecondsSince(begin), *std::ranges::min_element(reductions));
    row.iterations_per_message = iterations_per_message;
    (*server)->Shutdown(std::chrono::seconds(1));
    scheduler.Stop();
  }
  std::filesystem::remove_all(folder);
  return row;
}

JobRow RunByEngine(int jobs, int threads, int iterations) {
  std::mutex mutex;
  std::condition_variable ended;
  int left = 0;
  double worst = 100;
  NullStore store([&](const StateChange& change) {
    ORBITUNE_CHECK(change.report.has_value());
    const JobReport& report = *change.report;
    const std::lock_guard lock(mutex);
    worst = std::min(worst, 100 * (1 - report.final.episode.cost / report.initial.episode.cost));
    if (--left == 0) ended.notify_all();
  });
  EventHub hub;
  Scheduler scheduler(store, hub, {.threads = threads});
  ORBITUNE_CHECK(scheduler.Start().ok());
  const auto run = [&](int first, int count, int of_iterations) {
    worst = 100;
    left = count;
    for (int j = first; j < first + count; ++j) {
      JobRecord record{.id = absl::StrCat("bench", j), .last_seq = 1};
      record.spec.scenario = *FindPreset("gto-geo");
      record.spec.scenario.search.seed = static_cast<std::uint64_t>(j);
      record.spec.scenario.search.iterations = of_iterations;
      record.spec.initial_condition = record.spec.scenario.chaser;
      record.provenance.emplace();
      scheduler.Add(record);
    }
    std::unique_lock lock(mutex);
    ended.wait(lock, [&] { return left == 0; });
  };
  run(0, 1, 1);
  const auto begin = Clock::now();
  run(1, jobs, iterations);
  const double seconds = SecondsSince(begin);
  scheduler.Stop();
  return Row("engine", jobs, threads, iterations, seconds, worst);
}

std::vector<JobRow> CompareServerWithEngine(int threads, int iterations, int repeats) {
  std::vector<std::vector<JobRow>> runs;
  for (int i = 0; i < repeats; ++i) {
    std::vector<JobRow>& run = runs.emplace_back(3);
    // Each is first, second and last in turn.
    for (int k = 0; k < 3; ++k) {
      const int which = (i + k) % 3;
      run[static_cast<std::size_t>(which)] =
          which == 0 ? RunByEngine(1, threads, iterations)
                     : RunThroughServer(1, threads, iterations, which == 1 ? kIterationsPerMessage : 1);
    }
  }
  std::vector<JobRow> rows = runs[0];
  for (std::size_t r = 0; r < rows.size(); ++r) {
    std::vector<double> seconds;
    std::vector<double> added;
    for (const std::vector<JobRow>& run : runs) {
      seconds.push_back(run[r].seconds);
      added.push_back(100 * (run[r].seconds / run[0].seconds - 1));
      rows[r].worst_reduction_percent = std::min(rows[r].worst_reduction_percent, run[r].worst_reduction_percent);
    }
    rows[r].seconds = Median(seconds);
    rows[r].iterations_per_s = iterations / rows[r].seconds;
    if (r > 0) rows[r].added_percent = Median(added);
  }
  return rows;
}

}  // namespace orbitune::bench
