// `orbitune report`: fetches what the page of a job or a campaign shows, flying its episodes again.
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/campaign_commands.h"
#include "client/cli/campaign_fetch.h"
#include "client/cli/campaign_text.h"
#include "client/cli/errors.h"
#include "client/cli/files.h"
#include "client/cli/report_page.h"
#include "client/cli/session.h"

namespace orbitune::cli {
namespace {

constexpr int kIterationPage = 10'000;
constexpr std::size_t kMostMembersDrawn = 200;

template <typename Visit>
grpc::Status ForEachIteration(const Session& session, const std::string& job, const Visit& visit) {
  v1::ListIterationsRequest request;
  request.set_parent(job);
  request.set_page_size(kIterationPage);
  do {
    v1::ListIterationsResponse response;
    const grpc::Status status = session.Call(&v1::TuningService::Stub::ListIterations, request, &response);
    if (!status.ok()) return status;
    for (const v1::Iteration& iteration : response.iterations()) visit(iteration);
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return grpc::Status::OK;
}

// The distance in km over the time in hours, until it has settled for good. Empty where the episode cannot be flown.
grpc::Status Fly(const Session& session, const v1::Scenario& scenario, const v1::OrbitState& initial_condition,
                 const v1::Gains& gains, std::vector<PlotPoint>* distance) {
  v1::SimulateEpisodeRequest request;
  *request.mutable_scenario_definition() = scenario;
  *request.mutable_initial_condition() = initial_condition;
  *request.mutable_gains() = gains;
  request.set_early_exit(true);
  request.set_include_trajectory(true);
  v1::SimulateEpisodeResponse response;
  const grpc::Status status = session.Call(&v1::SimulationService::Stub::SimulateEpisode, request, &response);
  for (const v1::TrajectorySample& sample : response.trajectory()) {
    distance->push_back({sample.time_s() / 3600, sample.distance_km()});
  }
  return status;
}

struct Flight {
  const char* style;
  std::string title;
  const v1::Gains* gains;
};

grpc::Status FlyAll(const Session& session, const v1::Scenario& scenario, const v1::OrbitState& initial_condition,
                    const std::vector<Flight>& flights, std::vector<FlownGains>* flown) {
  for (const Flight& flight : flights) {
    FlownGains& gains = flown->emplace_back(FlownGains{.style = flight.style, .title = flight.title});
    const grpc::Status status = Fly(session, scenario, initial_condition, *flight.gains, &gains.distance);
    if (!status.ok()) return status;
  }
  return grpc::Status::OK;
}

grpc::Status MakeJobPage(const Session& session, const std::string& name, std::string* page) {
  JobPageData data;
  v1::GetJobRequest request;
  request.set_name(name);
  grpc::Status status = session.Call(&v1::TuningService::Stub::GetJob, request, &data.job);
  if (!status.ok()) return status;
  status = ForEachIteration(session, name, [&](const v1::Iteration& i) { data.iterations.push_back(i); });
  if (!status.ok()) return status;
  const v1::Job& job = data.job;
  std::vector<Flight> flights;
  if (job.has_initial_iteration()) flights.push_back({"before", "K(1)", &job.initial_iteration().gains()});
  if (job.completed_iterations() > 1) {
    flights.push_back({"after", absl::StrCat("K(", job.completed_iterations(), ")"), &job.latest_iteration().gains()});
  }
  if (job.has_best_iteration() && job.best_iteration().iteration() != job.completed_iterations()) {
    flights.push_back(
        {"best", absl::StrCat("best, K(", job.best_iteration().iteration(), ")"), &job.best_iteration().gains()});
  }
  status = FlyAll(session, job.scenario_definition(),
                  job.initial_conditions().empty() ? job.initial_condition() : job.initial_conditions(0), flights,
                  &data.flown);
  if (status.ok()) *page = JobPage(data);
  return status;
}

grpc::Status FetchLines(const Session& session, const v1::Campaign& campaign, const v1::CampaignMember& member,
                        std::size_t members, MemberLines* lines) {
  const v1::MemberEpisode* const before = FindEpisode(member, v1::GAINS_CHOICE_INITIAL);
  const v1::MemberEpisode* const after = FindEpisode(member, v1::GAINS_CHOICE_TUNED);
  const v1::Scenario& scenario = campaign.scenario_definition();
  grpc::Status status = Fly(session, scenario, member.initial_condition(), before->gains(), &lines->before);
  if (status.ok()) status = Fly(session, scenario, member.initial_condition(), after->gains(), &lines->after);
  if (!status.ok()) return status;
  status = ForEachIteration(session, member.job(), [&](const v1::Iteration& iteration) {
    const v1::Gains& k = iteration.gains();
    const double x = iteration.iteration();
    for (std::size_t i = 0; const double gain : {k.k1(), k.k2(), k.k3(), k.k4(), k.k5()}) {
      lines->gains[i++].push_back({x, gain});
    }
  });
  for (auto& gain : lines->gains) gain = Thin(gain, GainPointsPerLine(members));
  return status;
}

grpc::Status MakeCampaignPage(const Session& session, const std::string& name, std::string* page) {
  CampaignPageData data;
  grpc::Status status = FetchCampaign(session, name, &data.campaign);
  if (status.ok()) status = FetchMembers(session, name, &data.members);
  if (!status.ok()) return status;
  std::vector<const v1::CampaignMember*> drawn;
  for (const v1::CampaignMember& member : data.members) {
    if (member.role() == v1::MEMBER_ROLE_TUNED && FindEpisode(member, v1::GAINS_CHOICE_TUNED) != nullptr) {
      drawn.push_back(&member);
    }
  }
  const std::size_t step = (drawn.size() + kMostMembersDrawn - 1) / kMostMembersDrawn;
  const std::size_t members = step == 0 ? 0 : (drawn.size() + step - 1) / step;
  for (std::size_t i = 0; i < drawn.size(); i += step) {
    status = FetchLines(session, data.campaign, *drawn[i], members, &data.lines.emplace_back());
    if (!status.ok()) return status;
  }
  if (!drawn.empty() && data.campaign.has_results()) {
    const v1::CampaignMember& member = *drawn.front();
    const v1::CampaignResults& results = data.campaign.results();
    data.flown_at = member.number();
    std::vector<Flight> flights = {{"before", "K(1)", &FindEpisode(member, v1::GAINS_CHOICE_INITIAL)->gains()},
                                   {"after", "K*, its own", &FindEpisode(member, v1::GAINS_CHOICE_TUNED)->gains()},
                                   {"mean", "K-hat", &results.mean_gains()}};
    if (results.has_robust_gains()) flights.push_back({"robust", "robust K", &results.robust_gains()});
    status = FlyAll(session, data.campaign.scenario_definition(), member.initial_condition(), flights, &data.flown);
    if (!status.ok()) return status;
  }
  *page = CampaignPage(data);
  return status;
}

}  // namespace

int RunReport(Session& session, const ReportOptions& options) {
  std::string page;
  grpc::Status status;
  if (absl::StartsWith(options.name, "jobs/")) {
    status = MakeJobPage(session, options.name, &page);
  } else if (absl::StartsWith(options.name, "campaigns/")) {
    status = MakeCampaignPage(session, options.name, &page);
  } else {
    status = {grpc::StatusCode::INVALID_ARGUMENT,
              absl::StrCat("NAME must be jobs/ID or campaigns/ID, got '", options.name, "'")};
  }
  if (!status.ok()) return session.Fail(status);
  if (options.output == "-") {
    session.out() << page;
    return kExitOk;
  }
  OutputFile file(options.output);
  if (!file.status().ok()) return session.Fail(file.status());
  file.stream() << page;
  const absl::Status written = file.Commit();
  return written.ok() ? kExitOk : session.Fail(written);
}

}  // namespace orbitune::cli
