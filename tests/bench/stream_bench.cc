// orbitune_stream_bench: what watchers cost, and how soon they know. Runs the gto-geo job with and without watchers
// over SSE in turn, and tells the iteration rates, and for the runs with watchers the time from an iteration's commit
// to its arrival at each of them. Server and watchers share this process and its clock. Checks that every watcher got
// every event.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/api/api.h"
#include "server/rest/server.h"
#include "storage/sqlite_store.h"

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
};

struct Row {
  double iterations_per_s;
  std::vector<double> delays_ms;
};

class Bench {
 public:
  Bench(const std::string& database, int threads, int iterations) : iterations_(iterations) {
    auto store = OpenSqliteStore({.path = database});
    ORBITUNE_CHECK(store.ok());
    store_ = *std::move(store);
    scheduler_ = std::make_unique<Scheduler>(*store_, hub_, Scheduler::Options{.threads = threads});
    use_cases_ = std::make_unique<UseCases>(*store_, *scheduler_, hub_);
    ORBITUNE_CHECK(scheduler_->Start().ok());
    api_ = std::make_unique<Api>(*use_cases_);
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
    std::vector<Watcher> connections;
    for (int i = 0; i < watchers; ++i) connections.emplace_back(http_->address(), created->id);
    std::this_thread::sleep_for(std::chrono::milliseconds(200 + 2 * watchers));
    CommitTimes times(static_cast<std::size_t>(before + iterations_ + 3), static_cast<std::size_t>(before));
    const auto subscription = hub_.Subscribe(created->id, [&times] { times.Next(); });
    Row row;
    std::thread reader([&] { row.delays_ms = Follow(connections, times, before); });
    const auto begin = Clock::now();
    ORBITUNE_CHECK(use_cases_->ResumeJob(created->id, "").ok());
    while (!IsTerminal(use_cases_->GetJob(created->id)->state)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    row.iterations_per_s = iterations_ / std::chrono::duration<double>(Clock::now() - begin).count();
    reader.join();
    const std::int64_t last = use_cases_->GetJob(created->id)->last_seq;
    for (const Watcher& watcher : connections) ORBITUNE_CHECK(watcher.last_seq() == last);
    return row;
  }

 private:
  struct CommitTimes {
    CommitTimes(std::size_t events, std::size_t before) : at(events + 1), last(before) {}
    void Next() {
      if (last + 1 < at.size()) at[++last] = Clock::now();
    }
    std::vector<Clock::time_point> at;  // by seq; written before the event can be sent
    std::size_t last;
  };

  // Reads all to their ends; the delays of the events that came after `before`.
  static std::vector<double> Follow(std::vector<Watcher>& watchers, const CommitTimes& times, std::int64_t before) {
    std::vector<double> delays_ms;
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
        const auto now = Clock::now();
        const bool more = watcher.Read([&](std::int64_t seq) {
          if (seq <= before) return;
          delays_ms.push_back(
              std::chrono::duration<double, std::milli>(now - times.at[static_cast<std::size_t>(seq)]).count());
        });
        if (more) continue;
        epoll_ctl(poll, EPOLL_CTL_DEL, watcher.descriptor(), nullptr);
        --open;
      }
    }
    close(poll);
    return delays_ms;
  }

  const int iterations_;
  EventHub hub_;
  std::unique_ptr<JobStore> store_;
  std::unique_ptr<Scheduler> scheduler_;
  std::unique_ptr<UseCases> use_cases_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<HttpServer> http_;
};

double Quantile(std::vector<double>& values, double q) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double MedianRate(std::vector<Row>& rows) {
  std::vector<double> rates;
  for (const Row& row : rows) rates.push_back(row.iterations_per_s);
  return Quantile(rates, 0.5);
}

}  // namespace
}  // namespace orbitune

int main(int argc, char** argv) {
  int watchers = 10;
  int iterations = 2000;
  int threads = static_cast<int>(std::thread::hardware_concurrency());
  int repeats = 5;
  CLI::App app("What SSE watchers of a gto-geo job cost, and how soon they know.");
  app.add_option("--watchers", watchers)->capture_default_str();
  app.add_option("--iterations", iterations)->capture_default_str();
  app.add_option("--threads", threads, "of the scheduler")->capture_default_str();
  app.add_option("--repeats", repeats, "pairs of runs, with and without")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  using namespace orbitune;
  const auto folder = std::filesystem::temp_directory_path() / absl::StrCat("orbitune_stream_bench_", getpid());
  std::filesystem::create_directories(folder);
  {
    Bench bench((folder / "orbitune.db").string(), threads, iterations);
    bench.Run(0);  // warms up
    std::vector<Row> without;
    std::vector<Row> with;
    for (int i = 0; i < repeats; ++i) {
      without.push_back(bench.Run(0));
      with.push_back(bench.Run(watchers));
    }
    std::vector<double> delays;
    for (const Row& row : with) delays.insert(delays.end(), row.delays_ms.begin(), row.delays_ms.end());
    const double before = MedianRate(without);
    const double after = MedianRate(with);
    std::printf("iterations/s, median of %d: %.0f without watchers, %.0f with %d: %.1f %% fewer\n", repeats, before,
                after, watchers, 100 * (1 - after / before));
    std::printf("commit to arrival, ms: p50 %.2f, p90 %.2f, p99 %.2f, largest %.2f (%zu events)\n",
                Quantile(delays, 0.5), Quantile(delays, 0.9), Quantile(delays, 0.99), Quantile(delays, 1),
                delays.size());
  }
  std::filesystem::remove_all(folder);
  return 0;
}
