#include "server/convert/campaign.h"

#include <cmath>

#include "absl/strings/str_cat.h"

namespace orbitune {
namespace {

// The enums of the proto are the domain's in the same order, behind UNSPECIFIED.
template <typename Proto, typename T>
Proto FromOrder(T value) {
  return static_cast<Proto>(static_cast<int>(value) + 1);
}

void ToProto(const ReductionStatistics& s, v1::ReductionStatistics* out) {
  out->set_average(s.average);
  out->set_minimum(s.minimum);
  out->set_maximum(s.maximum);
  out->set_percentile_5(s.percentiles[0]);
  out->set_percentile_25(s.percentiles[1]);
  out->set_percentile_50(s.percentiles[2]);
  out->set_percentile_75(s.percentiles[3]);
  out->set_percentile_95(s.percentiles[4]);
}

void ToProto(const GainsComparison& c, v1::GainsComparison* out) {
  out->set_choice(FromOrder<v1::GainsChoice>(c.choice));
  out->set_over(FromOrder<v1::MemberRole>(c.over));
  out->set_flown(c.flown);
  out->set_settled(c.settled);
  out->set_not_settled(c.not_settled);
  out->set_without_cost(c.without_cost);
  out->set_compared(c.compared);
  ToProto(c.cost_percent, out->mutable_cost());
  ToProto(c.settling_time_percent, out->mutable_settling_time());
  ToProto(c.fuel_sum_percent, out->mutable_fuel_sum());
  ToProto(c.delta_v_percent, out->mutable_delta_v());
}

void ToProto(const CampaignResults& results, v1::CampaignResults* out) {
  out->set_mean_of(results.mean_of);
  orbitune::ToProto(results.mean_gains, out->mutable_mean_gains());
  if (results.robust_gains) orbitune::ToProto(*results.robust_gains, out->mutable_robust_gains());
  for (const GainsComparison& c : results.comparisons) ToProto(c, out->add_comparisons());
  if (results.best_on_held_out) out->set_best_on_held_out(FromOrder<v1::GainsChoice>(*results.best_on_held_out));
  out->set_conclusion(results.conclusion);
  out->set_episodes(results.episodes);
}

void ToProto(const CampaignStateChange& change, v1::CampaignStateChange* out) {
  out->set_state(FromOrder<v1::CampaignState>(change.state));
  SetTime(change.time_us, out->mutable_time());
  out->set_message(change.message);
  if (change.results) ToProto(*change.results, out->mutable_results());
}

void ToProto(const MemberEpisode& episode, const MemberView& view, v1::MemberEpisode* out) {
  out->set_choice(FromOrder<v1::GainsChoice>(episode.choice));
  orbitune::ToProto(episode.gains, out->mutable_gains());
  out->set_outcome(FromOrder<v1::Outcome>(episode.outcome));
  if (!HasCost(episode.outcome)) return;
  out->set_cost(episode.cost);
  out->set_settling_samples(episode.settling_samples);
  out->set_settling_time_s(episode.settling_samples * view.sampling_period_s);
  out->set_fuel_sum(episode.fuel_sum);
  if (!std::isnan(episode.delta_v_to_settling_m_s)) out->set_delta_v_to_settling_m_s(episode.delta_v_to_settling_m_s);
  for (const MemberEpisode& initial : view.member.episodes) {
    if (initial.choice != GainsChoice::kInitial || !(initial.cost > 0)) continue;
    out->set_cost_reduction_percent(100 * (1 - episode.cost / initial.cost));
  }
}

void SetCount(const MemberCounts& counts, v1::CampaignProgress::Count* out) {
  out->set_members(counts.members);
  out->set_jobs(counts.jobs);
  out->set_ended(counts.ended);
  out->set_succeeded(counts.succeeded);
  out->set_running(counts.running);
  out->set_completed_iterations(counts.iterations);
}

void SetDraw(const std::optional<InitialConditionDraws>& draws, v1::InitialConditions* out) {
  if (!draws) return;
  orbitune::ToProto(draws->distribution, out->mutable_draw()->mutable_distribution());
  out->mutable_draw()->set_seed(draws->seed);
  out->mutable_draw()->set_count(draws->count);
}

// Over the campaign's own hyperparameters; but a bound on the episodes of one initial condition is none on those of
// all.
v1::Hyperparameters RobustHyperparameters(const v1::Campaign& campaign) {
  v1::Hyperparameters merged = campaign.hyperparameters();
  merged.clear_algorithm();
  merged.clear_max_episodes();
  merged.MergeFrom(campaign.robust().hyperparameters());
  if (merged.algorithm() == v1::ALGORITHM_UNSPECIFIED) merged.set_algorithm(v1::ALGORITHM_CMA_ES);
  return merged;
}

// A job's violations, told of the campaign.
absl::Status OfCampaign(const absl::Status& status, std::string_view prefix) {
  FieldErrors errors;
  for (const FieldViolation& v : FieldViolationsOf(status)) {
    const std::string_view field = v.field;
    errors.AddViolation(
        {absl::StrCat(ToAbsl(prefix), ToAbsl(field.starts_with("job.") ? field.substr(4) : field)), v.description});
  }
  return errors.empty() ? status : errors.ToStatus();
}

}  // namespace

InitialConditionSource FromProto(const v1::InitialConditions& source) {
  InitialConditionSource out;
  for (const v1::OrbitState& state : source.list()) out.list.push_back(FromProto(state));
  if (!source.has_draw()) return out;
  InitialConditionSource::Draw& draw = out.draw.emplace();
  draw.distribution = FromProto(source.draw().distribution());
  if (source.draw().has_seed()) draw.seed = source.draw().seed();
  draw.count = source.draw().count();
  return out;
}

absl::StatusOr<CampaignRequest> FromProto(const v1::Campaign& campaign) {
  v1::Job job;
  job.set_display_name(campaign.display_name());
  *job.mutable_labels() = campaign.labels();
  job.set_priority(campaign.priority());
  job.set_scenario(campaign.scenario());
  if (campaign.has_scenario_definition()) *job.mutable_scenario_definition() = campaign.scenario_definition();
  *job.mutable_hyperparameters() = campaign.hyperparameters();
  job.set_warm_start(campaign.warm_start());
  auto common = FromProto(job);
  if (!common.ok()) return OfCampaign(common.status(), "campaign.");
  CampaignRequest request{.job = *std::move(common)};
  request.initial_conditions = FromProto(campaign.initial_conditions());
  request.held_out = FromProto(campaign.held_out());
  request.tune_held_out = campaign.tune_held_out();
  if (!campaign.has_robust()) return request;
  auto search = FromProto(RobustHyperparameters(campaign));
  if (!search.ok()) return OfCampaign(search.status(), "campaign.robust.hyperparameters.");
  CampaignRequest::Robust& robust = request.robust.emplace(CampaignRequest::Robust{.search = *std::move(search)});
  if (!campaign.robust().has_objective()) return request;
  const auto objective = FromProto(campaign.robust().objective());
  if (!objective.ok()) return OfCampaign(objective.status(), "campaign.robust.objective.");
  robust.objective = *objective;
  return request;
}

absl::StatusOr<std::vector<CampaignState>> FromProto(const v1::ListCampaignsRequest& request) {
  std::vector<CampaignState> states;
  for (const int state : request.states()) {
    if (state == v1::CAMPAIGN_STATE_UNSPECIFIED || !v1::CampaignState_IsValid(state)) {
      return InvalidField("states", "RUNNING, PAUSED, EVALUATING, SUCCEEDED, FAILED or CANCELLED", state);
    }
    states.push_back(static_cast<CampaignState>(state - 1));
  }
  return states;
}

void ToProto(const CampaignRecord& record, v1::CampaignProgress* out) {
  SetCount(record.of(MemberRole::kTuned), out->mutable_tuned());
  SetCount(record.of(MemberRole::kHeldOut), out->mutable_held_out());
  SetCount(record.of(MemberRole::kRobust), out->mutable_robust());
}

void ToProto(const CampaignRecord& record, v1::Campaign* out) {
  const CampaignSpec& spec = record.spec;
  out->set_display_name(spec.display_name);
  for (const auto& [key, value] : spec.labels) (*out->mutable_labels())[key] = value;
  if (!spec.scenario.id.empty()) out->set_scenario(absl::StrCat("scenarios/", spec.scenario.id));
  ToProto(spec.scenario, out->mutable_scenario_definition());
  ToProto(spec.scenario.search, out->mutable_hyperparameters());
  out->set_warm_start(spec.warm_start);
  SetDraw(spec.draws, out->mutable_initial_conditions());
  SetDraw(spec.held_out_draws, out->mutable_held_out());
  out->set_tune_held_out(spec.tune_held_out);
  out->set_owner(spec.owner);
  out->set_priority(spec.priority);
  if (spec.robust) {
    ToProto(spec.robust->search, out->mutable_robust()->mutable_hyperparameters());
    ToProto(spec.robust->objective, out->mutable_robust()->mutable_objective());
  }
  ToProto(record, out->mutable_progress());
  if (record.id.empty()) return;
  out->set_name(absl::StrCat("campaigns/", record.id));
  out->set_state(FromOrder<v1::CampaignState>(record.state));
  SetTime(record.create_time_us, out->mutable_create_time());
  if (record.end_time_us != 0) SetTime(record.end_time_us, out->mutable_end_time());
  SetTime(record.update_time_us, out->mutable_update_time());
  out->set_last_seq(record.last_seq);
  if (record.results) ToProto(*record.results, out->mutable_results());
  out->set_error_message(record.error_message);
  out->set_etag(EtagOf(record));
}

void ToProto(const MemberView& view, v1::CampaignMember* out) {
  const CampaignMember& member = view.member;
  out->set_role(FromOrder<v1::MemberRole>(member.id.role));
  out->set_number(member.id.number);
  if (!std::holds_alternative<std::monostate>(member.initial_condition)) {
    ToProto(member.initial_condition, out->mutable_initial_condition());
  }
  if (view.job) {
    out->set_job(absl::StrCat("jobs/", view.job->id));
    out->set_job_state(ToProto(view.job->state));
    out->set_completed_iterations(view.job->completed_iterations());
    out->set_error_message(view.job->error_message);
  }
  for (const MemberEpisode& episode : member.episodes) ToProto(episode, view, out->add_episodes());
}

void ToProto(const CampaignEventView& view, v1::WatchCampaignResponse* out) {
  out->set_seq(view.event.seq);
  if (view.member) return ToProto(*view.member, out->mutable_member_ended());
  ToProto(std::get<CampaignStateChange>(view.event.what), out->mutable_state_change());
}

}  // namespace orbitune
