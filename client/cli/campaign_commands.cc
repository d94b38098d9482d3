// `orbitune campaign create|list|show|extend|members|export|pause|resume|cancel|delete`.
#include "client/cli/campaign_commands.h"

#include <algorithm>

#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/cli/campaign_csv.h"
#include "client/cli/campaign_fetch.h"
#include "client/cli/campaign_text.h"
#include "client/cli/errors.h"
#include "client/cli/fields.h"
#include "client/cli/files.h"
#include "client/cli/format.h"
#include "client/cli/initial_condition_file.h"
#include "client/cli/json.h"
#include "client/cli/number.h"
#include "client/cli/parse.h"
#include "client/cli/resource_commands.h"
#include "client/cli/search_flags.h"
#include "client/cli/session.h"
#include "client/cli/submission.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

using Stub = v1::CampaignService::Stub;

constexpr std::int64_t kCampaignPage = 100;

absl::Status For(const char* option, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(option, ": ", status.message()));
}

absl::StatusOr<v1::InitialConditions> BuildSource(const InitialConditionOptions& options) {
  if (options.file.empty() == !options.count) {
    return absl::InvalidArgumentError("initial conditions are required: either --count N or --ics FILE");
  }
  if (!options.file.empty()) {
    auto listed = ReadInitialConditions(options.file);
    return listed.ok() ? listed : For("--ics", listed.status());
  }
  v1::InitialConditions source;
  source.mutable_draw()->set_count(*options.count);
  if (options.seed) source.mutable_draw()->set_seed(*options.seed);
  if (options.distribution.empty()) return source;
  const absl::Status status = ReadJsonFile(options.distribution, source.mutable_draw()->mutable_distribution());
  if (!status.ok()) return For("--distribution", status);
  return source;
}

absl::Status SetHeldOut(const CampaignCreateOptions& options, v1::Campaign* campaign) {
  if (options.held_out_count) campaign->mutable_held_out()->mutable_draw()->set_count(*options.held_out_count);
  if (!options.held_out_file.empty()) {
    const auto listed = ReadInitialConditions(options.held_out_file);
    if (!listed.ok()) return For("--held-out-ics", listed.status());
    *campaign->mutable_held_out() = *listed;
  }
  campaign->set_tune_held_out(options.tune_held_out);
  return absl::OkStatus();
}

absl::Status SetRobust(const CampaignCreateOptions& options, v1::Campaign* campaign) {
  if (!options.robust && options.robust_objective.empty() && !options.robust_episodes) return absl::OkStatus();
  v1::RobustTuning& robust = *campaign->mutable_robust();
  if (options.robust_episodes) robust.mutable_hyperparameters()->set_max_episodes(*options.robust_episodes);
  if (options.robust_objective.empty()) return absl::OkStatus();
  const auto objective = ParseObjective(options.robust_objective);
  if (!objective.ok()) return For("--robust-objective", objective.status());
  *robust.mutable_objective() = *objective;
  robust.mutable_objective()->set_relative_to_initial(true);
  return absl::OkStatus();
}

absl::StatusOr<v1::CreateCampaignRequest> BuildCreateCampaignRequest(const CampaignCreateOptions& options) {
  const absl::StatusOr<v1::CreateJobRequest> common = BuildCreateJobRequest(options.job);
  if (!common.ok()) return common.status();
  v1::CreateCampaignRequest request;
  request.set_request_id(common->request_id());
  request.set_validate_only(common->validate_only());
  v1::Campaign& campaign = *request.mutable_campaign();
  const v1::Job& job = common->job();
  campaign.set_display_name(job.display_name());
  *campaign.mutable_labels() = job.labels();
  campaign.set_priority(job.priority());
  campaign.set_scenario(job.scenario());
  if (job.has_scenario_definition()) *campaign.mutable_scenario_definition() = job.scenario_definition();
  *campaign.mutable_hyperparameters() = job.hyperparameters();
  campaign.set_warm_start(job.warm_start());
  InitialConditionOptions source = options.initial_conditions;
  if (!source.seed) source.seed = options.job.seed;
  const auto conditions = BuildSource(source);
  if (!conditions.ok()) return conditions.status();
  *campaign.mutable_initial_conditions() = *conditions;
  absl::Status status = SetHeldOut(options, &campaign);
  if (status.ok()) status = SetRobust(options, &campaign);
  if (!status.ok()) return status;
  return request;
}

void PrintName(const Session& session, const v1::Campaign& campaign) {
  if (session.json()) {
    session.out() << JsonLine(campaign) << std::flush;
  } else {
    session.out() << campaign.name() << "  " << CampaignStateText(campaign.state()) << std::endl;
  }
}

int Watch(Session& session, const std::string& name, std::int64_t from, double reconnect_s) {
  CampaignWatchOptions watch;
  watch.campaign = name;
  watch.from = from;
  watch.reconnect_s = reconnect_s;
  return RunCampaignWatch(session, watch);
}

grpc::Status Apply(const Session& session, Transition transition, const std::string& name) {
  switch (transition) {
    case Transition::kCancel:
      return Change(session, &Stub::CancelCampaign, name, PrintName);
    case Transition::kPause:
      return Change(session, &Stub::PauseCampaign, name, PrintName);
    case Transition::kResume:
      return Change(session, &Stub::ResumeCampaign, name, PrintName);
    case Transition::kDelete:
      break;
  }
  return Delete(session, &Stub::DeleteCampaign, name);
}

void AddRow(const v1::Campaign& campaign, Table& table) {
  const v1::CampaignProgress& progress = campaign.progress();
  table.AddRow({campaign.name(), CampaignStateText(campaign.state()),
                campaign.scenario().empty() ? "(own)" : Printable(campaign.scenario()),
                absl::StrCat(progress.tuned().ended(), "/", progress.tuned().members()),
                absl::StrCat(progress.held_out().members()), UtcTime(campaign.create_time()),
                Printable(campaign.display_name())});
}

std::string CostText(const v1::MemberEpisode* episode) {
  return episode != nullptr && episode->has_cost() ? Human(episode->cost()) : "-";
}

void AddRow(const v1::CampaignMember& member, Table& table) {
  const v1::MemberEpisode* const tuned = FindEpisode(member, v1::GAINS_CHOICE_TUNED);
  const v1::MemberEpisode* const mean = FindEpisode(member, v1::GAINS_CHOICE_MEAN);
  const v1::MemberEpisode* const robust = FindEpisode(member, v1::GAINS_CHOICE_ROBUST);
  const v1::MemberEpisode* const shown = tuned != nullptr ? tuned : mean;
  const bool settled = shown != nullptr && shown->has_settling_time_s();
  table.AddRow({RoleText(member.role()), absl::StrCat(member.number()), member.job(),
                member.job().empty() ? "" : StateText(member.job_state()),
                CostText(FindEpisode(member, v1::GAINS_CHOICE_INITIAL)), CostText(tuned),
                CostText(FindEpisode(member, v1::GAINS_CHOICE_BEST)), CostText(mean), CostText(robust),
                settled ? Human(shown->settling_time_s() / 3600) : "-", settled ? Human(shown->fuel_sum()) : "-",
                settled && shown->has_delta_v_to_settling_m_s() ? Human(shown->delta_v_to_settling_m_s()) : "-",
                tuned != nullptr ? GainsText(tuned->gains()) : ""});
}

absl::Status WriteText(const std::string& path, const std::string& text, std::ostream& out) {
  if (path.empty() || path == "-") {
    out << text << std::flush;
    return absl::OkStatus();
  }
  OutputFile file(path);
  if (!file.status().ok()) return file.status();
  file.stream() << text;
  return file.Commit();
}

// One document of the campaign and its members.
std::string CampaignJson(const v1::Campaign& campaign, const std::vector<v1::CampaignMember>& members) {
  std::string text = absl::StrCat("{\"campaign\":", JsonLine(campaign), ",\"members\":[\n");
  for (std::size_t i = 0; i < members.size(); ++i) absl::StrAppend(&text, i == 0 ? "" : ",", JsonLine(members[i]));
  return absl::StrCat(text, "]}\n");
}

}  // namespace

int RunCampaignCreate(Session& session, const CampaignCreateOptions& options) {
  const absl::StatusOr<v1::CreateCampaignRequest> request = BuildCreateCampaignRequest(options);
  if (!request.ok()) return session.Fail(request.status());
  v1::Campaign campaign;
  const grpc::Status status = session.Call(&Stub::CreateCampaign, *request, &campaign);
  if (!status.ok()) {
    const int code = session.Fail(status);
    if (code == kExitUnreachable && !session.json() && !options.job.validate_only) {
      session.err() << "  whether the campaign was stored is unknown; this finds out without storing it twice: "
                    << "the same command with --request-id " << request->request_id() << '\n';
    }
    return code;
  }
  if (options.job.validate_only && !session.json()) {
    session.out() << "The campaign is valid; nothing was stored. Its " << campaign.progress().tuned().members()
                  << " jobs would run with\n";
    PrintFields(campaign.hyperparameters(), 2, session.out());
    return kExitOk;
  }
  PrintName(session, campaign);
  if (options.job.validate_only) return kExitOk;
  if (options.job.watch) return Watch(session, campaign.name(), 0, options.job.reconnect_s);
  if (!session.json()) {
    session.out() << "watch it with: orbitune" << session.ServerFlag() << " campaign watch " << campaign.name() << '\n';
  }
  return kExitOk;
}

int RunCampaignList(Session& session, const CampaignListOptions& options) {
  v1::ListCampaignsRequest request;
  if (!options.state.empty()) {
    v1::CampaignState state = v1::CAMPAIGN_STATE_UNSPECIFIED;
    if (!v1::CampaignState_Parse(absl::StrCat("CAMPAIGN_STATE_", absl::AsciiStrToUpper(options.state)), &state)) {
      return session.Fail(absl::InvalidArgumentError(absl::StrCat(
          "--state: must be running, paused, evaluating, succeeded, failed or cancelled, got '", options.state, "'")));
    }
    request.add_states(state);
  }
  Table table({"NAME", "STATE", "SCENARIO", ">TUNED", ">HELD OUT", "CREATED", "TITLE"});
  std::int64_t count = 0;
  do {
    const std::int64_t left = options.limit == 0 ? kCampaignPage : std::min(kCampaignPage, options.limit - count);
    request.set_page_size(static_cast<int>(left));
    v1::ListCampaignsResponse response;
    const grpc::Status status = session.Call(&Stub::ListCampaigns, request, &response);
    if (!status.ok()) return session.Fail(status);
    for (const v1::Campaign& campaign : response.campaigns()) {
      ++count;
      if (session.json()) {
        session.out() << JsonLine(campaign);
      } else {
        AddRow(campaign, table);
      }
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty() && (options.limit == 0 || count < options.limit));
  if (!session.json()) table.Print(session.out());
  return kExitOk;
}

int RunCampaignShow(Session& session, const std::string& campaign_name) {
  v1::Campaign campaign;
  const grpc::Status status = FetchCampaign(session, campaign_name, &campaign);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonLine(campaign);
  } else {
    PrintCampaign(campaign, session.out());
  }
  return kExitOk;
}

int RunCampaignTransition(Session& session, Transition transition, const std::vector<std::string>& campaigns) {
  return ForEachName(session, "campaigns", campaigns,
                     [&](const std::string& name) { return Apply(session, transition, name); });
}

int RunCampaignExtend(Session& session, const CampaignExtendOptions& options) {
  const auto conditions = BuildSource(options.initial_conditions);
  if (!conditions.ok()) return session.Fail(conditions.status());
  v1::ExtendCampaignRequest request;
  request.set_name(ResourceName("campaigns", options.campaign));
  *request.mutable_initial_conditions() = *conditions;
  request.set_request_id(options.request_id.empty() ? RandomUuid() : options.request_id);
  v1::Campaign campaign;
  const grpc::Status status = session.Call(&Stub::ExtendCampaign, request, &campaign);
  if (!status.ok()) return session.Fail(status);
  PrintName(session, campaign);
  return options.watch ? Watch(session, campaign.name(), -1, options.reconnect_s) : kExitOk;
}

int RunCampaignMembers(Session& session, const std::string& campaign) {
  std::vector<v1::CampaignMember> members;
  const grpc::Status status = FetchMembers(session, campaign, &members);
  if (!status.ok()) return session.Fail(status);
  Table table({"ROLE", ">NO", "JOB", "STATE", ">J UNDER K(1)", ">K*", ">BEST", ">K-HAT", ">ROBUST", ">SETTLING H",
               ">FUEL", ">DELTA-V M/S", "K*"});
  for (const v1::CampaignMember& member : members) {
    if (session.json()) {
      session.out() << JsonLine(member);
    } else {
      AddRow(member, table);
    }
  }
  if (!session.json()) table.Print(session.out());
  return kExitOk;
}

int RunCampaignExport(Session& session, const CampaignExportOptions& options) {
  v1::Campaign campaign;
  std::vector<v1::CampaignMember> members;
  grpc::Status status = FetchCampaign(session, options.campaign, &campaign);
  if (status.ok()) status = FetchMembers(session, options.campaign, &members);
  if (!status.ok()) return session.Fail(status);
  const bool json = session.json() || options.format == "json";
  const std::string text = json ? CampaignJson(campaign, members) : CampaignCsv(members);
  const absl::Status written = WriteText(options.output, text, session.out());
  return written.ok() ? kExitOk : session.Fail(written);
}

}  // namespace orbitune::cli
