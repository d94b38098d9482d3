// One run of the program: where the server is, where output goes, and the calls.
#pragma once

#include <chrono>
#include <memory>
#include <ostream>
#include <string>
#include <tuple>

#include "absl/status/status.h"
#include "client/cli/app.h"
#include "grpcpp/channel.h"
#include "grpcpp/client_context.h"
#include "grpcpp/support/status.h"
#include "orbitune/v1/audit.grpc.pb.h"
#include "orbitune/v1/campaign.grpc.pb.h"
#include "orbitune/v1/gains.grpc.pb.h"
#include "orbitune/v1/scenario.grpc.pb.h"
#include "orbitune/v1/simulation.grpc.pb.h"
#include "orbitune/v1/tuning.grpc.pb.h"

namespace orbitune::cli {

class Session {
 public:
  // `terminal` must outlive the session.
  Session(const Globals& globals, const Terminal& terminal, const std::shared_ptr<grpc::Channel>& channel);

  std::ostream& out() const { return *terminal_.out; }
  std::ostream& err() const { return *terminal_.err; }
  const Terminal& terminal() const { return terminal_; }
  bool json() const { return globals_.json; }

  // The options that reach the same server from another command line: "", " --server HOST:PORT", ....
  std::string ServerFlag() const;

  // A unary call under the --timeout: Call(&v1::TuningService::Stub::GetJob, request, &job).
  template <typename Stub, typename Request, typename Response>
  grpc::Status Call(grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                    const Request& request, Response* response) const {
    grpc::ClientContext context;
    context.set_deadline(Deadline());
    return (std::get<std::unique_ptr<Stub>>(stubs_).get()->*method)(&context, request, response);
  }

  v1::TuningService::Stub& tuning() const { return *std::get<std::unique_ptr<v1::TuningService::Stub>>(stubs_); }

  v1::CampaignService::Stub& campaigns() const { return *std::get<std::unique_ptr<v1::CampaignService::Stub>>(stubs_); }

  // Prints the error; returns its exit code.
  int Fail(const grpc::Status& status) const;
  int Fail(const absl::Status& status) const;

 private:
  std::chrono::system_clock::time_point Deadline() const;

  const Globals globals_;
  const Terminal& terminal_;
  std::tuple<std::unique_ptr<v1::TuningService::Stub>, std::unique_ptr<v1::ScenarioService::Stub>,
             std::unique_ptr<v1::SimulationService::Stub>, std::unique_ptr<v1::CampaignService::Stub>,
             std::unique_ptr<v1::GainService::Stub>, std::unique_ptr<v1::AccessService::Stub>>
      stubs_;
};

}  // namespace orbitune::cli
