// orbitune_audit_bench: what the audit log costs a change. One client pauses and resumes a job over and over, through
// the API as the transports do, in turn with and without an audit log beside the jobs' database; and for comparison
// entries are written alone. Tells medians. The databases lie in --directory: it is its disk that is measured.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "orbitune/v1/tuning.pb.h"
#include "server/api/api.h"
#include "server/log/log.h"
#include "tests/server/engine_support.h"

namespace orbitune {
namespace {

using Clock = std::chrono::steady_clock;

class Times {
 public:
  void Measure(const std::function<void()>& what) {
    const auto begin = Clock::now();
    what();
    ms_.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
  }
  // The share q is quicker.
  double Ms(double q) {
    const auto at = ms_.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(ms_.size() - 1));
    std::ranges::nth_element(ms_, at);
    return *at;
  }

 private:
  std::vector<double> ms_;
};

// Has paused jobs and cancels them, one after another: each is a commit, and work for nobody else.
class Client {
 public:
  Client(server_test::Engine& engine, Access* access, int jobs)
      : api_(engine.use_cases(), engine.campaigns(), engine.gains(), access),
        cancel_(*api_.methods().Find("orbitune.v1.TuningService.CancelJob")) {
    for (int i = 0; i < jobs; ++i) {
      jobs_.push_back(engine.Create(server_test::EndlessScenario()));
      ORBITUNE_CHECK(engine.use_cases().PauseJob(jobs_.back(), "").ok());
    }
  }

  void Change() {
    v1::CancelJobRequest request;
    request.set_name("jobs/" + jobs_.back());
    jobs_.pop_back();
    v1::Job response;
    std::promise<absl::Status> answer;
    api_.Call(cancel_, {.caller = LocalCaller("127.0.0.1")}, request, &response,
              [&answer](const absl::Status& status) { answer.set_value(status); });
    ORBITUNE_CHECK(answer.get_future().get().ok());
  }

 private:
  Api api_;
  const Method& cancel_;
  std::vector<std::string> jobs_;
};

void Run(const std::string& folder, int calls) {
  auto access = Access::Open(folder + "/access.db");
  ORBITUNE_CHECK(access.ok());
  Times with;
  Times without;
  Times alone;
  {
    server_test::Engine engine(folder + "/with.db", {.threads = 1});
    server_test::Engine plain(folder + "/without.db", {.threads = 1});
    Client audited(engine, access->get(), calls);
    Client unaudited(plain, nullptr, calls);
    for (int i = 0; i < calls; ++i) {
      with.Measure([&] { audited.Change(); });
      without.Measure([&] { unaudited.Change(); });
      alone.Measure(
          [&] { (*access)->Audit(LocalCaller("127.0.0.1"), "orbitune.v1.TuningService.CancelJob", "jobs/a"); });
    }
  }
  const auto tell = [](const char* what, Times& times) {
    std::printf("%-24s p50 %.3f ms, p90 %.3f ms\n", what, times.Ms(0.5), times.Ms(0.9));
  };
  std::printf("%d of each, one after another\n", calls);
  tell("a change", without);
  tell("with its audit entry", with);
  tell("an audit entry alone", alone);
}

}  // namespace
}  // namespace orbitune

int main(int argc, char** argv) {
  int calls = 200;
  std::string directory = std::filesystem::temp_directory_path().string();
  CLI::App app("What the audit log costs a call that changes something.");
  app.add_option("--calls", calls)->capture_default_str();
  app.add_option("--directory", directory, "where databases are made, and removed again")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  orbitune::SetUpLog({.level = orbitune::LogLevel::kWarning, .json = false, .sink = {}});
  const std::string folder = absl::StrCat(directory, "/orbitune_audit_bench_", getpid());
  std::filesystem::create_directories(folder);
  orbitune::Run(folder, calls);
  std::filesystem::remove_all(folder);
  return 0;
}
