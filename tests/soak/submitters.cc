#include "tests/soak/submitters.h"

#include <grpcpp/grpcpp.h>

#include <cstdio>
#include <cstdlib>
#include <random>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"

namespace orbitune::soak {
namespace {

constexpr std::chrono::seconds kDeadline(30);

bool HasRetryInfo(const grpc::Status& status) {
  google::rpc::Status details;
  google::rpc::RetryInfo retry;
  if (!details.ParseFromString(status.error_details())) return false;
  for (const auto& detail : details.details()) {
    if (detail.UnpackTo(&retry)) return true;
  }
  return false;
}

class Submitter {
 public:
  Submitter(const std::string& address, int number, double pause_s, Journal& journal)
      : pause_s_(pause_s), journal_(journal), random_(static_cast<unsigned>(number)) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 500);
    const auto channel = grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments);
    tuning_ = v1::TuningService::NewStub(channel);
    simulation_ = v1::SimulationService::NewStub(channel);
  }

  void Run() {
    while (!journal_.stopping) OneJob();
  }

 private:
  // Submits a small job, asks for it until it has ended, lists, flies an episode, and deletes it.
  void OneJob() {
    v1::CreateJobRequest create;
    create.mutable_job()->set_scenario("scenarios/gto-geo");
    create.mutable_job()->mutable_hyperparameters()->set_iterations(20);
    create.mutable_job()->mutable_hyperparameters()->set_seed(random_());
    create.set_request_id(std::to_string(random_()) + "-" + std::to_string(random_()));
    v1::Job job;
    if (!Call(tuning_.get(), &v1::TuningService::Stub::CreateJob, create, &job)) return;
    v1::GetJobRequest get;
    get.set_name(job.name());
    while (!journal_.stopping && job.state() < v1::JOB_STATE_SUCCEEDED) {
      Call(tuning_.get(), &v1::TuningService::Stub::GetJob, get, &job);
      v1::ListJobsRequest list;
      list.set_page_size(10);
      v1::ListJobsResponse jobs;
      if (random_() % 8 == 0) Call(tuning_.get(), &v1::TuningService::Stub::ListJobs, list, &jobs);
      v1::SimulateEpisodeRequest simulate;
      simulate.set_scenario("scenarios/gto-geo");
      simulate.set_early_exit(true);
      v1::SimulateEpisodeResponse episode;
      if (random_() % 16 == 0) {
        Call(simulation_.get(), &v1::SimulationService::Stub::SimulateEpisode, simulate, &episode);
      }
    }
    if (job.state() == v1::JOB_STATE_FAILED) journal_.Fault(job.name() + " failed: " + job.error_message());
    if (job.state() < v1::JOB_STATE_SUCCEEDED) return;
    ++journal_.jobs_ended;
    v1::DeleteJobRequest remove;
    remove.set_name(job.name());
    google::protobuf::Empty empty;
    Call(tuning_.get(), &v1::TuningService::Stub::DeleteJob, remove, &empty);
  }

  template <typename Stub, typename Request, typename Response>
  bool Call(Stub* stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
            const Request& request, Response* response) {
    std::this_thread::sleep_for(std::chrono::duration<double>(pause_s_));
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + kDeadline);
    const auto begun = Clock::now();
    const grpc::Status status = (stub->*method)(&context, request, response);
    ++journal_.calls;
    if (status.ok()) {
      journal_.call_time.Note(std::chrono::duration<double>(Clock::now() - begun).count());
      return true;
    }
    const bool of_restart = journal_.restarting && status.error_code() == grpc::StatusCode::UNAVAILABLE;
    if (of_restart || (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && HasRetryInfo(status))) {
      journal_.Refusal();
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    } else {
      journal_.Fault("a call was answered " + std::to_string(status.error_code()) + " " + status.error_message());
    }
    return false;
  }

  const double pause_s_;
  Journal& journal_;
  std::mt19937 random_;
  std::unique_ptr<v1::TuningService::Stub> tuning_;
  std::unique_ptr<v1::SimulationService::Stub> simulation_;
};

}  // namespace

Submitters::Submitters(const std::string& address, int count, double pause_s, Journal& journal) {
  for (int i = 0; i < count; ++i) {
    threads_.emplace_back([=, &journal] { Submitter(address, i, pause_s, journal).Run(); });
  }
}

void Submitters::Stop() {
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

std::string CreateEndlessJob(const std::string& address, int number) {
  const auto stub = v1::TuningService::NewStub(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  v1::CreateJobRequest request;
  request.mutable_job()->set_scenario("scenarios/gto-geo");
  auto& parameters = *request.mutable_job()->mutable_hyperparameters();
  parameters.set_iterations(10'000'000);
  parameters.set_directions(200);  // some ten iterations a second beside the other jobs
  parameters.set_seed(static_cast<std::uint64_t>(number));
  v1::Job job;
  grpc::ClientContext context;
  const grpc::Status status = stub->CreateJob(&context, request, &job);
  if (status.ok()) return job.name();
  std::fprintf(stderr, "orbitune_soak: %s\n", status.error_message().c_str());
  std::_Exit(1);
}

}  // namespace orbitune::soak
