// orbitune_stream_bench: what watchers cost, and how soon they know. Runs the gto-geo job with and without watchers
// over SSE in turn, and tells the iteration rates, the processor time that the server and the watchers used, and for
// the runs with watchers the time from an iteration's commit to its arrival at each of them. The watchers are a process
// of their own on the same machine and clock. Checks that every watcher got every event.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/api/api.h"
#include "server/rest/server.h"
#include "storage/sqlite_store.h"
#include "tests/bench/median.h"

namespace orbitune {
namespace {

using Clock = std::chrono::steady_clock;

// One SSE connection, read as it comes; looks at "id: " lines only.
class Watcher {
 public:
  Watcher(const std::string& address, const std::string& job) {
    const std::size_t colon = address.rfind(':');
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(colon + 1))));
    inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr);
    socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ORBITUNE_CHECK(connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0);
    const std::string request =
        absl::StrCat("GET /v1/jobs/", job, ":watch HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n");
    ORBITUNE_CHECK(send(socket_, request.data(), request.size(), 0) == static_cast<ssize_t>(request.size()));
  }
  Watcher(Watcher&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  ~Watcher() {
    if (socket_ >= 0) close(socket_);
  }

  int descriptor() const { return socket_; }
  std::int64_t last_seq() const { return last_seq_; }
  bool there() const { return there_; }  // has its snapshot

  // What can be read now. False at the end. arrived(seq): for each event.
  template <typename Arrived>
  bool Read(Arrived arrived) {
    static thread_local char bytes[256 << 10];
    const ssize_t count = recv(socket_, bytes, sizeof bytes, 0);
    if (count <= 0) return false;
    text_.append(bytes, static_cast<std::size_t>(count));
    std::size_t at = 0;
    for (std::size_t end; (end = text_.find("\n\n", at)) != text_.npos; at = end + 2) {
      const std::size_t id = text_.find("id: ", at);
      if (id >= end) continue;
      there_ = true;
      const std::int64_t seq = std::strtoll(text_.c_str() + id + 4, nullptr, 10);
      if (seq == 0) continue;  // the snapshot
      ORBITUNE_CHECK(seq == last_seq_ + 1);
      last_seq_ = seq;
      arrived(seq);
    }
    text_.erase(0, at);
    return true;
  }

 private:
  int socket_;
  std::string text_;
  std::int64_t last_seq_ = 0;
  bool there_ = false;
};

constexpr std::size_t kMostEvents = 1 << 20;

// What both processes see.
struct Shared {
  std::atomic<std::int64_t> at_ns[kMostEvents];  // of the commit, by seq; written before the event can be sent
};

std::int64_t NowNs() { return std::chrono::nanoseconds(Clock::now().time_since_epoch()).count(); }

double ProcessorSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

template <typename T>
void Send(int to, const T& value) {
  ORBITUNE_CHECK(write(to, &value, sizeof value) == static_cast<ssize_t>(sizeof value));
}

template <typename T>
bool Receive(int from, T* value) {
  auto* bytes = reinterpret_cast<char*>(value);
  for (std::size_t got = 0; got < sizeof(T);) {
    const ssize_t count = read(from, bytes + got, sizeof(T) - got);
    if (count <= 0) return false;
    got += static_cast<std::size_t>(count);
  }
  return true;
}

// What the watchers' process is asked to do, and what it tells when all is there, and at the end.
struct Order {
  char address[64];
  char job[64];
  int watchers;
  std::int64_t before;  // the job's last event before it is resumed
};
struct Ready {};
struct Outcome {
  double processor_s = 0;
  std::int64_t last_seq = 0;  // of the watcher that got least
  std::int64_t events = 0;
  // Of the times from commit to arrival, by 0.1 ms; the last has all that is longer.
  std::int64_t delays[100'000] = {};
};

// The watchers' process: does as ordered until the pipe ends.
class Watching {
 public:
  explicit Watching(const Shared& shared) : shared_(shared) {}

  void Serve(int orders, int answers) {
    auto outcome = std::make_unique<Outcome>();
    for (Order order; Receive(orders, &order);) {
      *outcome = {};
      std::vector<Watcher> watchers;
      for (int i = 0; i < order.watchers; ++i) watchers.emplace_back(order.address, order.job);
      while (!std::ranges::all_of(watchers, [](const Watcher& w) { return w.there(); })) {
        for (Watcher& watcher : watchers) {
          if (!watcher.there()) watcher.Read([](std::int64_t) {});
        }
      }
      Send(answers, Ready());
      const double begin = ProcessorSeconds();
      Follow(watchers, order.before, outcome.get());
      outcome->processor_s = ProcessorSeconds() - begin;
      Send(answers, *outcome);
    }
  }

 private:
  // Reads all to their ends.
  void Follow(std::vector<Watcher>& watchers, std::int64_t before, Outcome* outcome) {
    const int poll = epoll_create1(EPOLL_CLOEXEC);
    for (std::size_t i = 0; i < watchers.size(); ++i) {
      epoll_event event{.events = EPOLLIN, .data = {.u64 = i}};
      epoll_ctl(poll, EPOLL_CTL_ADD, watchers[i].descriptor(), &event);
    }
    std::size_t open = watchers.size();
    epoll_event ready[64];
    while (open > 0) {
      const int count = epoll_wait(poll, ready, 64, -1);
      for (int i = 0; i < count; ++i) {
        Watcher& watcher = watchers[ready[i].data.u64];
        const std::int64_t now = NowNs();
        const bool more = watcher.Read([&](std::int64_t seq) {
          if (seq > before) Count(now - shared_.at_ns[seq], outcome);
        });
        if (more) continue;
        epoll_ctl(poll, EPOLL_CTL_DEL, watcher.descriptor(), nullptr);
        --open;
      }
    }
    close(poll);
    outcome->last_seq = watchers.front().last_seq();
    for (const Watcher& watcher : watchers) outcome->last_seq = std::min(outcome->last_seq, watcher.last_seq());
  }

  static void Count(std::int64_t delay_ns, Outcome* outcome) {
    ++outcome->events;
    ++outcome->delays[std::clamp<std::int64_t>(delay_ns / 100'000, 0, std::ssize(outcome->delays) - 1)];
  }

  const Shared& shared_;
};

struct Row {
  double iterations_per_s = 0;
  double server_ms = 0;  // of processor time, per iteration, workers included
  double watchers_ms = 0;
};

class Bench {
 public:
  Bench(const std::string& database, int threads, int iterations, int orders, int answers, Shared& shared)
      : iterations_(iterations), orders_(orders), answers_(answers), shared_(shared) {
    auto store = OpenSqliteStore({.path = database});
    ORBITUNE_CHECK(store.ok());
    store_ = *std::move(store);
    scheduler_ = std::make_unique<Scheduler>(*store_, hub_, Scheduler::Options{.threads = threads});
    use_cases_ = std::make_unique<UseCases>(*store_, *scheduler_, hub_);
    ORBITUNE_CHECK(scheduler_->Start().ok());
    campaign_engine_ = std::make_unique<CampaignEngine>(*store_, store_->campaigns(), *scheduler_, hub_);
    campaigns_ = std::make_unique<CampaignUseCases>(*use_cases_, store_->campaigns(), *campaign_engine_);
    gains_ = std::make_unique<GainUseCases>(*store_, library_);
    api_ = std::make_unique<Api>(*use_cases_, *campaigns_, *gains_);
    auto http = HttpServer::Start({.address = "127.0.0.1:0", .max_connections = 10'000}, *api_);
    ORBITUNE_CHECK(http.ok());
    http_ = *std::move(http);
  }
  ~Bench() {
    http_->Shutdown(std::chrono::seconds(1));
    scheduler_->Stop();
  }

  // The job begins once all watchers are there.
  Row Run(int watchers) {
    NewJob job;
    job.scenario.preset_id = "gto-geo";
    job.search.iterations = iterations_;
    job.search.seed = 1;
    const auto created = use_cases_->CreateJob(job, "", false);
    ORBITUNE_CHECK(created.ok() && use_cases_->PauseJob(created->id, "").ok());
    const std::int64_t before = use_cases_->GetJob(created->id)->last_seq;
    if (watchers > 0) Gather(created->id, watchers, before);
    std::int64_t seq = before;
    const auto subscription = hub_.Subscribe(created->id, [&] { shared_.at_ns[++seq] = NowNs(); });
    const double processor_s = ProcessorSeconds();
    const auto begin = Clock::now();
    ORBITUNE_CHECK(use_cases_->ResumeJob(created->id, "").ok());
    while (!IsTerminal(use_cases_->GetJob(created->id)->state)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    Row row;
    row.iterations_per_s = iterations_ / std::chrono::duration<double>(Clock::now() - begin).count();
    Outcome outcome;
    if (watchers > 0) {
      ORBITUNE_CHECK(Receive(answers_, &outcome));
      ORBITUNE_CHECK(outcome.last_seq == use_cases_->GetJob(created->id)->last_seq);
      for (std::size_t i = 0; i < delays_.size(); ++i) delays_[i] += outcome.delays[i];
      events_ += outcome.events;
    }
    row.server_ms = 1000 * (ProcessorSeconds() - processor_s) / iterations_;
    row.watchers_ms = 1000 * outcome.processor_s / iterations_;
    return row;
  }

  // The time within which the share q of all events arrived.
  double DelayMs(double q) const {
    std::int64_t left = static_cast<std::int64_t>(q * static_cast<double>(events_));
    std::size_t i = 0;
    while (i + 1 < delays_.size() && left > delays_[i]) left -= delays_[i++];
    return 0.1 * static_cast<double>(i + 1);
  }
  std::int64_t events() const { return events_; }

 private:
  void Gather(const std::string& job, int watchers, std::int64_t before) {
    Order order{.address = {}, .job = {}, .watchers = watchers, .before = before};
    http_->address().copy(order.address, sizeof order.address - 1);
    job.copy(order.job, sizeof order.job - 1);
    Send(orders_, order);
    Ready ready;
    ORBITUNE_CHECK(Receive(answers_, &ready));
  }

  const int iterations_;
  const int orders_;  // pipes to and from the watchers' process
  const int answers_;
  Shared& shared_;
  std::vector<std::int64_t> delays_ = std::vector<std::int64_t>(std::size(Outcome().delays));
  std::int64_t events_ = 0;
  EventHub hub_;
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<Scheduler> scheduler_;
  std::unique_ptr<UseCases> use_cases_;
  GainLibrary library_;
  std::unique_ptr<CampaignEngine> campaign_engine_;
  std::unique_ptr<CampaignUseCases> campaigns_;
  std::unique_ptr<GainUseCases> gains_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<HttpServer> http_;
};

double MedianOf(const std::vector<Row>& rows, double Row::*value) {
  std::vector<double> values;
  for (const Row& row : rows) values.push_back(row.*value);
  return bench::Median(std::move(values));
}

double PeakMemoryMib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024;
  }
  return 0;
}

}  // namespace
}  // namespace orbitune

int main(int argc, char** argv) {
  int watchers = 10;
  int iterations = 2000;
  int threads = static_cast<int>(std::thread::hardware_concurrency());
  int repeats = 5;
  int watchers_nice = 0;
  CLI::App app("What SSE watchers of a gto-geo job cost, and how soon they know.");
  app.add_option("--watchers", watchers)->capture_default_str();
  app.add_option("--iterations", iterations)->capture_default_str();
  app.add_option("--threads", threads, "of the scheduler")->capture_default_str();
  app.add_option("--repeats", repeats, "pairs of runs, with and without")->capture_default_str();
  app.add_option("--watchers-nice", watchers_nice, "of the watchers' process")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  using namespace orbitune;
  void* memory = mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ORBITUNE_CHECK(memory != MAP_FAILED);
  auto& shared = *static_cast<Shared*>(memory);
  int orders[2];
  int answers[2];
  ORBITUNE_CHECK(pipe2(orders, O_CLOEXEC) == 0 && pipe2(answers, O_CLOEXEC) == 0);
  // Before there are threads.
  if (fork() == 0) {
    close(orders[1]);
    if (watchers_nice != 0) ORBITUNE_CHECK(nice(watchers_nice) != -1);
    Watching(shared).Serve(orders[0], answers[1]);
    _exit(0);
  }
  const auto folder = std::filesystem::temp_directory_path() / absl::StrCat("orbitune_stream_bench_", getpid());
  std::filesystem::create_directories(folder);
  {
    Bench bench((folder / "orbitune.db").string(), threads, iterations, orders[1], answers[0], shared);
    bench.Run(0);  // warms up
    std::vector<Row> without;
    std::vector<Row> with;
    for (int i = 0; i < repeats; ++i) {
      without.push_back(bench.Run(0));
      with.push_back(bench.Run(watchers));
    }
    const double before = MedianOf(without, &Row::iterations_per_s);
    const double after = MedianOf(with, &Row::iterations_per_s);
    std::printf("iterations/s, median of %d: %.0f without watchers, %.0f with %d: %.1f %% fewer\n", repeats, before,
                after, watchers, 100 * (1 - after / before));
    const double alone = MedianOf(without, &Row::server_ms);
    const double watched = MedianOf(with, &Row::server_ms);
    std::printf("processor time per iteration, ms: server %.3f without, %.3f with: %.1f %% more; watchers %.3f\n",
                alone, watched, 100 * (watched / alone - 1), MedianOf(with, &Row::watchers_ms));
    std::printf("commit to arrival, ms: p50 %.1f, p90 %.1f, p99 %.1f (%lld events); server's peak memory %.0f MiB\n",
                bench.DelayMs(0.5), bench.DelayMs(0.9), bench.DelayMs(0.99), static_cast<long long>(bench.events()),
                PeakMemoryMib());
  }
  close(orders[1]);
  wait(nullptr);
  std::filesystem::remove_all(folder);
  return 0;
}
