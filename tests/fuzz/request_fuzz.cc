// HTTP requests, from the target and body to the message: routes, percent-encoding, the query's fields, JSON,
// Last-Event-ID.
#include <memory>

#include "orbitune/v1/campaign.pb.h"
#include "orbitune/v1/gains.pb.h"
#include "orbitune/v1/simulation.pb.h"
#include "orbitune/v1/tuning.pb.h"
#include "server/api/json.h"
#include "server/rest/http.h"
#include "server/rest/routes.h"
#include "server/rest/text.h"
#include "server/rest/transcode.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

// Has the methods, and answers none.
struct Nobody {
  template <typename Request, typename Response>
  absl::Status Answer(const Request&, Response*) {
    return absl::OkStatus();
  }
  template <typename Request>
  std::shared_ptr<Feed> Open(const Request&) {
    return nullptr;
  }
};

// A method of every shape: fields in the path, in the query, in the body; nested, repeated, optional.
const rest::RouteTable& Routes() {
  static const rest::RouteTable* const routes = [] {
    static Nobody nobody;
    auto& methods = *new MethodTable;
    const auto add = [&]<typename Request, typename Response>(const char* name, Request, Response) {
      methods.Add(name, Work::kRead, &nobody, &Nobody::Answer<Request, Response>);
    };
    add("orbitune.v1.TuningService.CreateJob", v1::CreateJobRequest(), v1::Job());
    add("orbitune.v1.TuningService.GetJob", v1::GetJobRequest(), v1::Job());
    add("orbitune.v1.TuningService.ListJobs", v1::ListJobsRequest(), v1::ListJobsResponse());
    add("orbitune.v1.TuningService.PauseJob", v1::PauseJobRequest(), v1::Job());
    add("orbitune.v1.TuningService.ListIterations", v1::ListIterationsRequest(), v1::ListIterationsResponse());
    add("orbitune.v1.CampaignService.CreateCampaign", v1::CreateCampaignRequest(), v1::Campaign());
    add("orbitune.v1.CampaignService.ExtendCampaign", v1::ExtendCampaignRequest(), v1::Campaign());
    add("orbitune.v1.GainService.QueryGains", v1::QueryGainsRequest(), v1::QueryGainsResponse());
    add("orbitune.v1.GainService.ImportGainSets", v1::ImportGainSetsRequest(), v1::ImportGainSetsResponse());
    add("orbitune.v1.SimulationService.SimulateEpisode", v1::SimulateEpisodeRequest(), v1::SimulateEpisodeResponse());
    methods.AddStream<v1::WatchJobResponse>("orbitune.v1.TuningService.WatchJob", &nobody,
                                            &Nobody::Open<v1::WatchJobRequest>);
    return new rest::RouteTable(methods);
  }();
  return *routes;
}

// The first line is the method and target, the second a header's value, the rest the body.
void Request(std::string_view input) {
  std::string_view line = TakeLine(input);
  const std::string_view method = line.substr(0, line.find(' '));
  line.remove_prefix(std::min(method.size() + 1, line.size()));
  const std::string_view header = TakeLine(input);
  (void)rest::Accepts(header, "gzip");
  auto target = rest::ParseTarget(line);
  if (!target.ok()) return;
  const rest::RouteTable::Match match = Routes().Find(method, target->path);
  if (match.route == nullptr) return;
  if (match.route->method->open != nullptr) target->query.push_back({"resume_after_seq", std::string(header)});
  const std::unique_ptr<google::protobuf::Message> message(match.route->method->request->New());
  if (!rest::ReadRequest(*match.route, match.bindings, target->query, std::string(input), message.get()).ok()) return;
  const std::unique_ptr<google::protobuf::Message> again(message->New());
  Expect(FromJson(ToJson(*message), again.get()).ok(), "a request that was read can be told in JSON");
}

// Texts that decode are UTF-8 without a NUL.
void Encoding(std::string_view input) {
  const bool plus = TakeChoice(input, 2) == 0;
  const auto text = rest::PercentDecode(input, plus);
  if (!text.ok()) return;
  Expect(rest::IsUtf8(*text) && text->find('\0') == text->npos, "what decodes is text");
  std::string json = "{\"filter\":" + QuoteJson(*text) + "}";
  v1::ListJobsRequest request;
  Expect(FromJson(json, &request).ok() && request.filter() == *text, "what is quoted is read as it was");
}

const Registration kRequest("request", Request);
const Registration kEncoding("encoding", Encoding);

}  // namespace
}  // namespace orbitune::fuzz
