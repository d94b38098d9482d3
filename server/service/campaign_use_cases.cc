#include "server/service/campaign_use_cases.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "server/jobs/campaign_results.h"
#include "server/service/page_token.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

constexpr std::size_t kMostNamedFaults = 20;  // of initial conditions, in one answer

// Violations as another message's: what began with `from` begins with `to`, everything else comes under it.
void AddRenamed(FieldErrors& errors, const absl::Status& status, std::string_view from, std::string_view to) {
  for (const FieldViolation& v : FieldViolationsOf(status)) {
    const std::string_view field = v.field;
    const bool known = field.starts_with(from);
    errors.AddViolation(
        {absl::StrCat(ToAbsl(to), known ? "" : ".", ToAbsl(known ? field.substr(from.size()) : field)), v.description});
  }
}

absl::Status CheckRequestId(const std::string& request_id) {
  FieldErrors errors;
  if (request_id.size() > kLongestRequestId) {
    errors.Add("request_id", absl::StrCat("at most ", kLongestRequestId, " bytes"), FormatReceived(request_id));
  }
  return errors.ToStatus();
}

int SizeOf(const InitialConditionSource& source) {
  return source.draw ? source.draw->count : static_cast<int>(source.list.size());
}

// field: of the source. least: initial conditions.
absl::Status CheckSource(const InitialConditionSource& source, std::string_view field, int least) {
  FieldErrors errors;
  if (source.draw && !source.list.empty()) {
    errors.Add(field, "given either as a list or as a draw", "both");
  } else if (source.draw && (source.draw->count < 1 || source.draw->count > CampaignUseCases::kMostInitialConditions)) {
    errors.AddNumber(absl::StrCat(ToAbsl(field), ".draw.count"),
                     absl::StrCat("in [1, ", CampaignUseCases::kMostInitialConditions, "]"), source.draw->count);
  } else if (!source.draw && static_cast<int>(source.list.size()) < least) {
    errors.Add(field, "given as a list or as a draw", "neither");
  } else if (source.list.size() > CampaignUseCases::kMostInitialConditions) {
    errors.AddNumber(absl::StrCat(ToAbsl(field), ".list"),
                     absl::StrCat("of at most ", CampaignUseCases::kMostInitialConditions, " initial conditions"),
                     static_cast<double>(source.list.size()));
  }
  return errors.ToStatus();
}

// Every one must be a start for this scenario.
absl::Status CheckStates(const Scenario& scenario, const std::vector<OrbitState>& states, bool drawn,
                         std::string_view field, const std::function<bool()>& cancelled) {
  FieldErrors errors;
  std::size_t faults = 0;
  for (std::size_t i = 0; i < states.size() && faults < kMostNamedFaults; ++i) {
    if (cancelled && cancelled()) return absl::CancelledError("nobody waits for the campaign any more");
    const std::string path = absl::StrCat(ToAbsl(field), drawn ? ".draw" : ".list", "[", i, "]");
    const bool given = !std::holds_alternative<std::monostate>(states[i]);
    const absl::Status status = given ? Prepare(scenario, states[i]).status() : absl::OkStatus();
    if (given && status.ok()) continue;
    ++faults;
    if (!given) errors.Add(path, "one form of an orbit", "none");
    AddRenamed(errors, status, "initial_condition", path);
  }
  return errors.ToStatus();
}

// `count` more of what the draws give, and the draws as they are then.
absl::StatusOr<std::vector<OrbitState>> DrawOn(InitialConditionDraws& draws, DrawSet set, int count,
                                               std::string_view field) {
  FieldErrors errors;
  const std::string path = absl::StrCat(ToAbsl(field), ".draw.distribution");
  if (absl::Status status = Validate(draws.distribution); !status.ok()) {
    errors.Merge(path, status);
    return errors.ToStatus();
  }
  auto states = DrawMany(draws.distribution, draws.seed, set, static_cast<std::uint32_t>(draws.count),
                         static_cast<std::uint32_t>(count));
  if (!states.ok()) {
    errors.Merge(path, states.status());
    return errors.ToStatus();
  }
  draws.count += count;
  return states;
}

// What a source gives at a campaign's creation; `draws` is set where it is drawn.
absl::StatusOr<std::vector<OrbitState>> Take(const InitialConditionSource& source, DrawSet set,
                                             const InitialConditionDraws& without_saying, std::string_view field,
                                             std::optional<InitialConditionDraws>& draws) {
  if (!source.draw) return source.list;
  const bool own = !std::holds_alternative<std::monostate>(source.draw->distribution);
  InitialConditionDraws from{.distribution = own ? source.draw->distribution : without_saying.distribution,
                             .seed = source.draw->seed.value_or(without_saying.seed)};
  if (std::holds_alternative<std::monostate>(from.distribution)) {
    FieldErrors errors;
    errors.Add(absl::StrCat(ToAbsl(field), ".draw.distribution"), "given: the scenario has none of its own", "nothing");
    return errors.ToStatus();
  }
  auto states = DrawOn(from, set, source.draw->count, field);
  if (states.ok()) draws = std::move(from);
  return states;
}

std::string Lines(const std::vector<OrbitState>& states) {
  std::string text;
  for (const OrbitState& state : states) absl::StrAppend(&text, ToJson(state), "\n");
  return text;
}

// What a request id stands for.
std::string DigestOf(const std::string& what, const InitialConditionSource& source) {
  std::string draw;
  if (source.draw) {
    draw = absl::StrCat(ToJson({source.draw->distribution, source.draw->seed.value_or(0), source.draw->count}), " ",
                        source.draw->seed.has_value());
  }
  return absl::StrCat(what, "\n", draw, "\n", Lines(source.list));
}

std::string MemberTitle(const CampaignSpec& spec, MemberRole role, int number) {
  const char* const what = role == MemberRole::kRobust    ? "robust tuning "
                           : role == MemberRole::kHeldOut ? "held-out initial condition "
                                                          : "initial condition ";
  return absl::StrCat(spec.display_name, spec.display_name.empty() ? "" : ", ", what, number);
}

}  // namespace

// The campaign's spec, and the states of both sets.
struct CampaignUseCases::Resolved {
  CampaignSpec spec;
  std::vector<OrbitState> tuned;
  std::vector<OrbitState> held_out;
};

absl::StatusOr<CampaignUseCases::Resolved> CampaignUseCases::Resolve(const CampaignRequest& request,
                                                                     const std::function<bool()>& cancelled) const {
  FieldErrors errors;
  const auto job = use_cases_.ResolveJob(request.job);
  AddRenamed(errors, job.status(), "job.", "campaign.");
  for (const auto& [source, field, least] : {std::tuple{&request.initial_conditions, "initial_conditions", 1},
                                             std::tuple{&request.held_out, "held_out", 0}}) {
    const absl::Status status = CheckSource(*source, absl::StrCat("campaign.", field), least);
    for (const FieldViolation& v : FieldViolationsOf(status)) errors.AddViolation(v);
  }
  if (request.tune_held_out && SizeOf(request.held_out) == 0) {
    errors.Add("campaign.tune_held_out", "false where no initial conditions are held out", "true");
  }
  if (!errors.empty()) return errors.ToStatus();
  if (!job.ok()) return job.status();

  Resolved resolved;
  resolved.spec = {.display_name = job->display_name,
                   .labels = job->labels,
                   .scenario = job->scenario,
                   .warm_start = job->warm_start,
                   .tune_held_out = request.tune_held_out,
                   .owner = job->owner,
                   .peer = job->peer,
                   .priority = job->priority};
  CampaignSpec& spec = resolved.spec;
  auto tuned = Take(request.initial_conditions, DrawSet::kTuning, {job->scenario.neighbourhood, 1},
                    "campaign.initial_conditions", spec.draws);
  if (!tuned.ok()) return tuned.status();
  auto held_out =
      Take(request.held_out, DrawSet::kHeldOut,
           spec.draws.value_or(InitialConditionDraws{.distribution = job->scenario.neighbourhood, .seed = 1}),
           "campaign.held_out", spec.held_out_draws);
  if (!held_out.ok()) return held_out.status();
  for (const absl::Status& status :
       {CheckStates(spec.scenario, *tuned, spec.draws.has_value(), "campaign.initial_conditions", cancelled),
        CheckStates(spec.scenario, *held_out, spec.held_out_draws.has_value(), "campaign.held_out", cancelled)}) {
    if (absl::IsCancelled(status)) return status;
    for (const FieldViolation& v : FieldViolationsOf(status)) errors.AddViolation(v);
  }
  if (!errors.empty()) return errors.ToStatus();
  resolved.tuned = *std::move(tuned);
  resolved.held_out = *std::move(held_out);
  if (!request.robust) return resolved;
  auto robust = ResolveRobust(request, resolved.tuned);
  if (!robust.ok()) return robust.status();
  spec.robust = *std::move(robust);
  return resolved;
}

// As the job that it becomes, over all the tuned initial conditions.
absl::StatusOr<RobustTuning> CampaignUseCases::ResolveRobust(const CampaignRequest& request,
                                                             const std::vector<OrbitState>& tuned) const {
  NewJob robust = request.job;
  robust.search = request.robust->search;
  robust.initial_conditions = tuned;
  robust.objective = request.robust->objective.value_or(Objective{.relative_to_initial = true});
  const auto job = use_cases_.ResolveJob(robust);
  if (job.ok()) return RobustTuning{.search = job->scenario.search, .objective = job->objective};
  FieldErrors errors;
  AddRenamed(errors, job.status(), "job.", "campaign.robust.");
  return errors.empty() ? job.status() : errors.ToStatus();
}

std::vector<NewMember> CampaignUseCases::MakeMembers(const std::string& id, const CampaignSpec& spec, MemberRole role,
                                                     int first, const std::vector<OrbitState>& states) {
  std::vector<NewMember> members;
  const bool tuned = role == MemberRole::kTuned || spec.tune_held_out;
  for (int number = first; const OrbitState& state : states) {
    NewMember& member = members.emplace_back();
    member.member = {.id = {.role = role, .number = number}, .initial_condition = state};
    if (tuned) {
      member.member.job_id = NewId();
      JobSpec& job = member.job.emplace();
      job.display_name = MemberTitle(spec, role, number);
      job.labels = spec.labels;
      job.scenario = spec.scenario;
      job.scenario.search.seed += static_cast<std::uint64_t>(number - 1);
      job.initial_condition = state;
      job.warm_start = spec.warm_start;
      job.campaign_id = id;
      job.owner = spec.owner;
      job.peer = spec.peer;
      job.priority = spec.priority;
    }
    ++number;
  }
  return members;
}

NewMember CampaignUseCases::MakeRobustMember(const std::string& id, const CampaignSpec& spec, int number,
                                             const std::vector<OrbitState>& tuned) {
  NewMember member;
  member.member = {.id = {.role = MemberRole::kRobust, .number = number}, .initial_condition = {}, .job_id = NewId()};
  JobSpec& job = member.job.emplace();
  job.display_name = MemberTitle(spec, MemberRole::kRobust, number);
  job.labels = spec.labels;
  job.scenario = spec.scenario;
  job.scenario.search = spec.robust->search;
  job.initial_condition = tuned.front();
  job.initial_conditions = tuned;
  job.objective = spec.robust->objective;
  job.warm_start = spec.warm_start;
  job.campaign_id = id;
  job.owner = spec.owner;
  job.peer = spec.peer;
  job.priority = spec.priority;
  return member;
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Create(const CampaignRequest& request, const std::string& request_id,
                                                        bool validate_only, const std::function<bool()>& cancelled) {
  if (absl::Status status = CheckRequestId(request_id); !status.ok()) return status;
  auto resolved = Resolve(request, cancelled);
  if (!resolved.ok()) return resolved.status();
  const CampaignSpec& spec = resolved->spec;
  CampaignSpec asked_for = spec;
  asked_for.peer.clear();
  const auto spec_json = ToJson(asked_for);
  if (!spec_json.ok()) return spec_json.status();
  if (validate_only) {
    CampaignRecord record{.spec = spec, .create_time_us = NowUs()};
    record.counts[0].members = static_cast<int>(resolved->tuned.size());
    record.counts[1].members = static_cast<int>(resolved->held_out.size());
    return record;
  }
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  NewCampaign campaign{.id = NewId(), .spec = spec, .time_us = NowUs(), .request_id = request_id};
  campaign.request_digest =
      DigestOf(absl::StrCat("create\n", *spec_json, "\n", DigestOf("", request.held_out)), request.initial_conditions);
  campaign.members = MakeMembers(campaign.id, spec, MemberRole::kTuned, 1, resolved->tuned);
  for (NewMember& member : MakeMembers(campaign.id, spec, MemberRole::kHeldOut, 1, resolved->held_out)) {
    campaign.members.push_back(std::move(member));
  }
  if (spec.robust) campaign.members.push_back(MakeRobustMember(campaign.id, spec, 1, resolved->tuned));
  return engine_.Create(std::move(campaign));
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Get(const std::string& id) { return store_.GetCampaign(id); }

absl::StatusOr<Page<CampaignRecord>> CampaignUseCases::List(int page_size, const std::string& page_token,
                                                            const std::vector<CampaignState>& states) {
  const auto size = PageSize(page_size, 50, 1000);
  if (!size.ok()) return size.status();
  CampaignQuery query{.states = states, .limit = *size + 1};  // the one beyond tells whether there is a next page
  std::string list = "campaigns";
  for (const CampaignState state : states) absl::StrAppend(&list, "\n", ToAbsl(NameOf(state)));
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, list, 2);
    if (!parts.ok()) return parts.status();
    CampaignQuery::Cursor cursor{.id = parts->at(1)};
    (void)absl::SimpleAtoi(parts->at(0), &cursor.create_time_us);
    query.after = std::move(cursor);
  }
  auto campaigns = store_.ListCampaigns(query);
  if (!campaigns.ok()) return campaigns.status();
  Page<CampaignRecord> page{.items = *std::move(campaigns)};
  if (page.items.size() == static_cast<std::size_t>(query.limit)) {
    page.items.pop_back();
    const CampaignRecord& last = page.items.back();
    page.next_page_token = MakePageToken(list, {absl::StrCat(last.create_time_us), last.id});
  }
  return page;
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Pause(const std::string& id, const std::string& etag) {
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  return engine_.Pause(id, etag);
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Resume(const std::string& id, const std::string& etag) {
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  return engine_.Resume(id, etag);
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Cancel(const std::string& id, const std::string& etag) {
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  return engine_.Cancel(id, etag);
}

absl::Status CampaignUseCases::Delete(const std::string& id, const std::string& etag) {
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  return engine_.Delete(id, etag);
}

absl::StatusOr<CampaignRecord> CampaignUseCases::Extend(const std::string& id, const InitialConditionSource& more,
                                                        const std::string& request_id, const std::string& etag,
                                                        const std::function<bool()>& cancelled) {
  if (absl::Status status = CheckRequestId(request_id); !status.ok()) return status;
  if (absl::Status status = CheckSource(more, "initial_conditions", 1); !status.ok()) return status;
  if (absl::Status status = use_cases_.store().ok_for_now(); !status.ok()) return status;
  return engine_.Extend(id, etag, request_id, DigestOf(absl::StrCat("extend\n", id), more),
                        [&](const CampaignRecord& record) { return MakeExtension(record, more, cancelled); });
}

absl::StatusOr<std::vector<OrbitState>> CampaignUseCases::TunedStates(const std::string& id) {
  const auto members = store_.ListMembers(id, {}, kMostInitialConditions);
  if (!members.ok()) return members.status();
  std::vector<OrbitState> states;
  for (const CampaignMember& member : *members) {
    if (member.id.role == MemberRole::kTuned) states.push_back(member.initial_condition);
  }
  return states;
}

// Draws go on from the last one, unless another distribution or seed is given.
absl::StatusOr<std::vector<OrbitState>> CampaignUseCases::MoreStates(CampaignSpec& spec,
                                                                     const InitialConditionSource& more) {
  if (!more.draw) return more.list;
  const InitialConditionDraws now = spec.draws.value_or(InitialConditionDraws{.seed = 1});
  const bool other = !std::holds_alternative<std::monostate>(more.draw->distribution);
  InitialConditionDraws from{.distribution = other ? more.draw->distribution : now.distribution,
                             .seed = more.draw->seed.value_or(now.seed)};
  if (std::holds_alternative<std::monostate>(from.distribution)) {
    FieldErrors errors;
    errors.Add("initial_conditions.draw.distribution", "given: this campaign's initial conditions were listed",
               "nothing");
    return errors.ToStatus();
  }
  if (ToJson(InitialConditionDraws{from.distribution, from.seed, 0}) ==
      ToJson(InitialConditionDraws{now.distribution, now.seed, 0})) {
    from.count = now.count;
  }
  auto states = DrawOn(from, DrawSet::kTuning, more.draw->count, "initial_conditions");
  if (states.ok()) spec.draws = std::move(from);
  return states;
}

absl::StatusOr<CampaignExtension> CampaignUseCases::MakeExtension(const CampaignRecord& record,
                                                                  const InitialConditionSource& more,
                                                                  const std::function<bool()>& cancelled) {
  const int tuned = record.of(MemberRole::kTuned).members;
  if (tuned + SizeOf(more) > kMostInitialConditions) {
    return InvalidField("initial_conditions",
                        absl::StrCat("at most ", kMostInitialConditions - tuned, " more: the campaign has ", tuned),
                        SizeOf(more));
  }
  CampaignExtension extension{.spec = record.spec};
  auto states = MoreStates(extension.spec, more);
  if (!states.ok()) return states.status();
  absl::Status status =
      CheckStates(record.spec.scenario, *states, more.draw.has_value(), "initial_conditions", cancelled);
  if (!status.ok()) return status;
  extension.members = MakeMembers(record.id, extension.spec, MemberRole::kTuned, tuned + 1, *states);
  extension.change.message = absl::StrCat("extended by ", states->size(), " initial conditions");
  if (!record.spec.robust) return extension;
  auto all = TunedStates(record.id);
  if (!all.ok()) return all.status();
  all->insert(all->end(), states->begin(), states->end());
  if (all->size() > kMostStarts) {
    return InvalidField("initial_conditions", absl::StrCat("at most ", kMostStarts, " in all with a robust tuning"),
                        static_cast<double>(all->size()));
  }
  extension.members.push_back(
      MakeRobustMember(record.id, extension.spec, record.of(MemberRole::kRobust).members + 1, *all));
  return extension;
}

absl::StatusOr<MemberView> CampaignUseCases::View(const CampaignSpec& spec, CampaignMember member) {
  MemberView view{.member = std::move(member), .sampling_period_s = spec.scenario.sampling_period_s};
  if (view.member.job_id.empty()) return view;
  auto job = use_cases_.GetJob(view.member.job_id);
  if (!job.ok()) return job.status();
  if (view.member.episodes.empty() && job->report) {
    view.member.episodes = EpisodesOf(*job->report, job->spec.scenario.search.algorithm);
  }
  view.job = *std::move(job);
  return view;
}

absl::StatusOr<Page<MemberView>> CampaignUseCases::ListMembers(const std::string& id, int page_size,
                                                               const std::string& page_token) {
  const auto size = PageSize(page_size, 100, 1000);
  if (!size.ok()) return size.status();
  const std::string list = absl::StrCat("members\n", id);
  MemberId after;
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, list, 2);
    if (!parts.ok()) return parts.status();
    int role = 0;
    (void)absl::SimpleAtoi(parts->at(0), &role);
    (void)absl::SimpleAtoi(parts->at(1), &after.number);
    after.role = static_cast<MemberRole>(role);
  }
  const auto campaign = store_.GetCampaign(id);
  if (!campaign.ok()) return campaign.status();
  auto members = store_.ListMembers(id, after, *size + 1);
  if (!members.ok()) return members.status();
  Page<MemberView> page;
  if (members->size() > static_cast<std::size_t>(*size)) {
    members->pop_back();
    const MemberId& last = members->back().id;
    page.next_page_token = MakePageToken(list, {absl::StrCat(static_cast<int>(last.role)), absl::StrCat(last.number)});
  }
  for (CampaignMember& member : *members) {
    auto view = View(campaign->spec, std::move(member));
    if (!view.ok()) return view.status();
    page.items.push_back(*std::move(view));
  }
  return page;
}

absl::StatusOr<std::vector<CampaignEventView>> CampaignUseCases::ListEvents(const std::string& id,
                                                                            std::int64_t after_seq, int limit) {
  auto events = store_.ListCampaignEvents(id, after_seq, limit);
  if (!events.ok()) return events.status();
  const auto campaign = store_.GetCampaign(id);
  if (!campaign.ok()) return campaign.status();
  std::vector<CampaignEventView> views;
  for (CampaignEvent& event : *events) {
    CampaignEventView& view = views.emplace_back(CampaignEventView{.event = std::move(event)});
    const auto* ended = std::get_if<MemberEnded>(&view.event.what);
    if (ended == nullptr) continue;
    const MemberId before{.role = ended->member.role, .number = ended->member.number - 1};
    auto member = store_.ListMembers(id, before, 1);
    if (!member.ok()) return member.status();
    if (member->empty()) return absl::DataLossError(absl::StrCat("campaign ", id, ": a member is missing"));
    member->front().episodes.clear();  // as they were known then: those of its own job
    auto whole = View(campaign->spec, std::move(member->front()));
    if (!whole.ok()) return whole.status();
    view.member = *std::move(whole);
  }
  return views;
}

}  // namespace orbitune
