#include "server/service/use_cases.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <future>
#include <random>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "core/search/ensemble_search.h"
#include "core/sim/scalar_simulator.h"
#include "server/jobs/report.h"
#include "server/service/list_filter.h"
#include "server/service/page_token.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

constexpr std::chrono::milliseconds kBetweenLooks(200);  // at the disk, while a caller waits for it
constexpr std::size_t kLongestDescription = 4096;
constexpr std::size_t kLongestId = 64;
constexpr std::size_t kMostLabels = 64;
constexpr std::string_view kIdCharacters = "a to z, 0 to 9, '.', '_' and '-'";

bool IsIdText(std::string_view text) {
  return std::ranges::all_of(text, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
  });
}

void CheckLength(FieldErrors& errors, std::string_view field, const std::string& text, std::size_t longest) {
  if (text.size() > longest) errors.Add(field, absl::StrCat("at most ", longest, " bytes"), FormatReceived(text));
}

void CheckId(FieldErrors& errors, std::string_view field, const std::string& text, std::size_t shortest) {
  if (text.size() < shortest || text.size() > kLongestId || !IsIdText(text)) {
    errors.Add(field, absl::StrCat(shortest, " to ", kLongestId, " of ", ToAbsl(kIdCharacters)), FormatReceived(text));
  }
}

void CheckLabels(FieldErrors& errors, const std::map<std::string, std::string>& labels) {
  if (labels.size() > kMostLabels) {
    errors.Add("labels", absl::StrCat("at most ", kMostLabels), absl::StrCat(labels.size()));
  }
  for (const auto& [key, value] : labels) {
    CheckId(errors, "labels key", key, 1);
    CheckLength(errors, absl::StrCat("labels.", key.substr(0, kLongestId)), value, kLongestName);
  }
}

absl::Status UnknownScenario(const std::string& id) {
  std::string known;
  for (const Scenario& preset : Presets()) absl::StrAppend(&known, known.empty() ? "" : ", ", "scenarios/", preset.id);
  FieldErrors errors;
  errors.Add("scenario", absl::StrCat("one of ", known, ", or a scenario_definition"), FormatReceived(id));
  return errors.ToStatus();
}

// A definition that bears a preset's name is not that preset, and must not pass for it in a list.
std::string IdOfDefinition(const std::string& id) {
  return FindPreset(id) == nullptr ? id : absl::StrCat(id, "-modified");
}

absl::StatusOr<Scenario> Choose(const ScenarioChoice& choice) {
  FieldErrors errors;
  if (choice.definition.has_value() == !choice.preset_id.empty()) {
    errors.Add("scenario", "given either by name or as a scenario_definition", choice.definition ? "both" : "neither");
    return errors.ToStatus();
  }
  if (!choice.definition) {
    const Scenario* preset = FindPreset(choice.preset_id);
    return preset == nullptr ? absl::StatusOr<Scenario>(UnknownScenario(choice.preset_id)) : *preset;
  }
  Scenario scenario = *choice.definition;
  CheckId(errors, "scenario_definition.name", scenario.id, 0);
  CheckLength(errors, "scenario_definition.display_name", scenario.display_name, kLongestName);
  CheckLength(errors, "scenario_definition.description", scenario.description, kLongestDescription);
  errors.Merge("scenario_definition", scenario.Validate());
  if (!errors.empty()) return errors.ToStatus();
  scenario.id = IdOfDefinition(scenario.id);
  return scenario;
}

// Each is named where it was given.
void CheckSearch(FieldErrors& errors, const NewJob& job, const JobSpec& spec) {
  for (const absl::Status& status :
       {spec.scenario.search.Validate(), CheckBudget(spec.scenario.search, spec.starts().size())}) {
    for (const FieldViolation& v : FieldViolationsOf(status)) {
      const bool of_definition = job.scenario.definition && !job.search.Sets(v.field);
      errors.AddViolation(
          {absl::StrCat(of_definition ? "scenario_definition." : "", "hyperparameters.", v.field), v.description});
    }
  }
}

// Up to the first initial condition with a fault: the scenario's own would come again with each.
void CheckFlights(FieldErrors& errors, const JobSpec& spec) {
  const std::span<const OrbitState> starts = spec.starts();
  absl::Status status;
  for (std::size_t i = 0; i < starts.size() && status.ok(); ++i) {
    status = Prepare(spec.scenario, starts[i]).status();
    for (const FieldViolation& v : FieldViolationsOf(status)) {
      constexpr std::string_view kStart = "initial_condition";
      if (!v.field.starts_with(kStart)) {
        errors.AddViolation({absl::StrCat("scenario_definition.", v.field), v.description});
      } else if (spec.initial_conditions.empty()) {
        errors.AddViolation(v);
      } else {
        errors.AddViolation(
            {absl::StrCat("initial_conditions[", i, "]", v.field.substr(kStart.size())), v.description});
      }
    }
  }
}

void CheckEnsemble(FieldErrors& errors, const NewJob& job) {
  errors.Merge("objective", job.objective.Validate());
  const bool one = !std::holds_alternative<std::monostate>(job.initial_condition);
  if (one && !job.initial_conditions.empty()) {
    errors.Add("initial_conditions", "empty where an initial_condition is given",
               absl::StrCat(job.initial_conditions.size()));
  }
  if (job.initial_conditions.size() > kMostStarts) {
    errors.Add("initial_conditions", absl::StrCat("at most ", kMostStarts),
               absl::StrCat(job.initial_conditions.size()));
  }
  for (std::size_t i = 0; i < job.initial_conditions.size(); ++i) {
    if (!std::holds_alternative<std::monostate>(job.initial_conditions[i])) continue;
    errors.Add(absl::StrCat("initial_conditions[", i, "]"), "one form of an orbit", "none");
    return;
  }
  const Objective& o = job.objective;
  if (job.initial_conditions.empty() && (o.aggregate != Aggregate::kMean || o.relative_to_initial)) {
    errors.Add("objective", "given with initial_conditions only", "no initial_conditions");
  }
}

// The spec a job runs with, everything filled in.
// start: the gains that job.warm_start names.
absl::StatusOr<JobSpec> Resolve(const NewJob& job, const std::optional<Gains>& start) {
  FieldErrors errors;
  CheckLength(errors, "display_name", job.display_name, kLongestName);
  CheckLabels(errors, job.labels);
  if (job.priority < kLowestPriority || job.priority > kHighestPriority) {
    errors.AddNumber("priority", absl::StrCat("in [", kLowestPriority, ", ", kHighestPriority, "]"), job.priority);
  }
  CheckEnsemble(errors, job);
  JobSpec spec{.display_name = job.display_name,
               .labels = job.labels,
               .initial_conditions = job.initial_conditions,
               .objective = job.objective,
               .warm_start = job.warm_start,
               .campaign_id = job.campaign_id,
               .owner = job.owner,
               .peer = job.peer,
               .priority = job.priority};
  auto scenario = Choose(job.scenario);
  if (scenario.ok()) {
    spec.scenario = *std::move(scenario);
    SearchOptions& search = spec.scenario.search;
    job.search.ApplyTo(search);
    if (start) search.initial_gains = WithinBounds(search, *start);
    const bool own = std::holds_alternative<std::monostate>(job.initial_condition);
    spec.initial_condition = !job.initial_conditions.empty() ? job.initial_conditions.front()
                             : own                           ? spec.scenario.chaser
                                                             : job.initial_condition;
    if (search.algorithm != Algorithm::kArs && search.max_episodes == 0) {
      search.max_episodes = SearchOptions::kDefaultEpisodes * std::ssize(spec.starts());
    }
    CheckSearch(errors, job, spec);
    CheckFlights(errors, spec);
  }
  FieldErrors all;
  for (const absl::Status& status : {errors.ToStatus(), scenario.status()}) {
    for (const FieldViolation& v : FieldViolationsOf(status))
      all.AddViolation({absl::StrCat("job.", v.field), v.description});
  }
  if (!all.empty()) return all.ToStatus();
  return spec;
}

}  // namespace

absl::StatusOr<Scenario> ChooseScenario(const ScenarioChoice& choice) { return Choose(choice); }

std::string NewId() {
  static constexpr std::string_view kAlphabet = "abcdefghijklmnopqrstuvwxyz234567";
  std::random_device random;
  std::string id;
  for (int i = 0; i < 12; ++i) id += kAlphabet[random() % kAlphabet.size()];
  return id;
}

// The overrides beside what they override, by the names of SearchOptions::Validate: visit(name, override, option).
template <typename V>
void VisitOverrides(const SearchOverrides& s, SearchOptions& o, V&& visit) {
  visit("iterations", s.iterations, o.iterations);
  visit("step_size", s.step_size, o.step_size);
  visit("exploration_scale", s.exploration_scale, o.exploration_scale);
  visit("directions", s.directions, o.directions);
  visit("initial_gains", s.initial_gains, o.initial_gains);
  visit("exploration_std", s.exploration_std, o.exploration_std);
  visit("gain_floor", s.gain_floor, o.gain_floor);
  visit("seed", s.seed, o.seed);
  visit("algorithm", s.algorithm, o.algorithm);
  visit("max_episodes", s.max_episodes, o.max_episodes);
  visit("plateau_stop.iterations", s.plateau_iterations, o.plateau_stop.iterations);
  visit("plateau_stop.min_improvement", s.plateau_min_improvement, o.plateau_stop.min_improvement);
  visit("ars_variants.top_directions", s.top_directions, o.ars_variants.top_directions);
  visit("ars_variants.step_schedule", s.step_schedule, o.ars_variants.step_schedule);
  visit("ars_variants.exploration_schedule", s.exploration_schedule, o.ars_variants.exploration_schedule);
  visit("ars_variants.log_gains", s.log_gains, o.ars_variants.log_gains);
  visit("cma_es.population", s.population, o.cma_es.population);
  visit("cma_es.initial_sigma", s.initial_sigma, o.cma_es.initial_sigma);
  visit("cma_es.restarts", s.cma_es_restarts, o.cma_es.restarts);
  visit("cma_es.population_growth", s.population_growth, o.cma_es.population_growth);
  visit("nelder_mead.initial_step", s.initial_step, o.nelder_mead.initial_step);
  visit("nelder_mead.restarts", s.nelder_mead_restarts, o.nelder_mead.restarts);
}

void SearchOverrides::ApplyTo(SearchOptions& options) const {
  VisitOverrides(*this, options, [](const char*, const auto& given, auto& option) { option = given.value_or(option); });
}

bool SearchOverrides::Sets(std::string_view field) const {
  SearchOptions unused;
  bool sets = false;
  VisitOverrides(*this, unused, [&](std::string_view name, const auto& given, auto&) {
    sets = sets || (given && (field == name || (field.starts_with(name) && field[name.size()] == '.')));
  });
  return sets;
}

absl::StatusOr<JobSpec> UseCases::ResolveJob(const NewJob& job) {
  if (job.warm_start.empty()) return Resolve(job, std::nullopt);
  FieldErrors errors;
  if (job.search.initial_gains) errors.Add("warm_start", "empty where initial_gains are given", job.warm_start);
  const absl::StatusOr<WarmStart> start =
      errors.empty() ? FindWarmStart(store_, gain_sets_, job.warm_start) : absl::StatusOr<WarmStart>(errors.ToStatus());
  absl::Status status = start.status();
  if (status.ok()) {
    absl::StatusOr<JobSpec> spec = Resolve(job, start->gains);
    if (!spec.ok()) return spec;
    status = CheckUnits(*start, *spec);
    if (status.ok()) return spec;
  }
  if (!absl::IsInvalidArgument(status)) return status;
  FieldErrors in_job;
  in_job.Merge("job", status);
  return in_job.ToStatus();
}

absl::StatusOr<JobRecord> UseCases::CreateJob(const NewJob& job, const std::string& request_id, bool validate_only) {
  FieldErrors errors;
  CheckLength(errors, "request_id", request_id, kLongestRequestId);
  if (!errors.empty()) return errors.ToStatus();
  absl::StatusOr<JobSpec> spec = ResolveJob(job);
  if (!spec.ok()) return spec.status();
  if (validate_only) return JobRecord{.spec = *std::move(spec), .create_time_us = NowUs()};
  if (absl::Status status = store_.ok_for_now(); !status.ok()) return status;
  const auto room = scheduler_.Reserve(*spec, 1);
  if (!room.ok()) return room.status();
  const std::string id = NewId();
  JobSpec asked_for = *spec;
  asked_for.peer.clear();
  const auto digest = ToJson(asked_for);
  if (!digest.ok()) return digest.status();
  std::promise<absl::StatusOr<JobRecord>> created;
  store_.CreateJob(id, *std::move(spec), NowUs(), request_id, *digest,
                   [&created](absl::StatusOr<JobRecord> record) { created.set_value(std::move(record)); });
  auto record = created.get_future().get();
  if (record.ok() && record->id == id) {  // else an earlier call created it
    hub_.Publish(record->id, {.seq = 1, .what = StateChange{.time_us = record->create_time_us}});
    scheduler_.Add(*record);
  }
  return record;
}

absl::StatusOr<JobRecord> UseCases::GetJob(const std::string& id) { return store_.GetJob(id); }

absl::StatusOr<Page<JobRecord>> UseCases::ListJobs(int page_size, const std::string& page_token,
                                                   const std::string& filter, const std::string& order_by) {
  FieldErrors errors;
  CheckLength(errors, "filter", filter, 4096);
  CheckLength(errors, "page_token", page_token, 4096);
  if (!errors.empty()) return errors.ToStatus();
  JobQuery query;
  auto parsed = ParseFilter(filter);
  if (!parsed.ok()) return parsed.status();
  query.filter = *std::move(parsed);
  if (absl::Status status = ParseOrder(order_by, query); !status.ok()) return status;
  const auto size = PageSize(page_size, 50, 1000);
  if (!size.ok()) return size.status();
  const std::string list = absl::StrCat("jobs\n", filter, "\n", order_by);
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, list, 2);
    if (!parts.ok()) return parts.status();
    double key = kUnset;
    (void)absl::SimpleAtod(parts->at(0), &key);
    query.after = JobQuery::Cursor{.key = key, .id = parts->at(1)};
  }
  query.limit = *size + 1;  // the one beyond tells whether there is a next page
  auto jobs = store_.ListJobs(query);
  if (!jobs.ok()) return jobs.status();
  Page<JobRecord> page{.items = *std::move(jobs)};
  if (page.items.size() == static_cast<std::size_t>(query.limit)) {
    page.items.pop_back();
    const JobRecord& last = page.items.back();
    const double key = query.order == JobQuery::Order::kCreateTime ? static_cast<double>(last.create_time_us)
                       : last.best                                 ? last.best->cost
                                                                   : kUnset;
    page.next_page_token = MakePageToken(list, {FormatNumber(key), last.id});
  }
  return page;
}

absl::StatusOr<JobRecord> UseCases::Await(Transition transition, const std::string& id, const std::string& etag) {
  if (absl::Status status = store_.ok_for_now(); !status.ok()) return status;
  const auto changed = std::make_shared<std::promise<absl::StatusOr<JobRecord>>>();
  auto answer = changed->get_future();
  (scheduler_.*transition)(id, etag,
                           [changed](absl::StatusOr<JobRecord> record) { changed->set_value(std::move(record)); });
  while (answer.wait_for(kBetweenLooks) != std::future_status::ready) {
    const absl::Status disk = store_.ok_for_now();
    if (disk.ok()) continue;
    // It cannot be taken back any more, and its caller need not wait for the disk.
    return absl::UnavailableError(
        absl::StrCat("jobs/", id, ": the change will be stored once the disk is back: ", disk.message()));
  }
  return answer.get();
}

// A campaign halts and removes its jobs together; what becomes of one of them alone is not its plan.
absl::Status UseCases::CheckAlone(const std::string& id, std::string_view action) const {
  const auto record = store_.GetJob(id);
  if (!record.ok() || record->spec.campaign_id.empty()) return record.status();
  return WithReason(
      absl::FailedPreconditionError(
          absl::StrCat("jobs/", id, " is part of campaigns/", record->spec.campaign_id, ": ", ToAbsl(action), " that")),
      "CAMPAIGN_MEMBER");
}

absl::StatusOr<JobRecord> UseCases::PauseJob(const std::string& id, const std::string& etag) {
  if (absl::Status status = CheckAlone(id, "pause"); !status.ok()) return status;
  return Await(&Scheduler::Pause, id, etag);
}

absl::StatusOr<JobRecord> UseCases::ResumeJob(const std::string& id, const std::string& etag) {
  if (absl::Status status = CheckAlone(id, "resume"); !status.ok()) return status;
  return Await(&Scheduler::Resume, id, etag);
}

absl::StatusOr<JobRecord> UseCases::CancelJob(const std::string& id, const std::string& etag) {
  return Await(&Scheduler::Cancel, id, etag);
}

absl::Status UseCases::DeleteJob(const std::string& id, const std::string& etag) {
  if (absl::Status status = CheckAlone(id, "delete"); !status.ok()) return status;
  const auto record = store_.GetJob(id);
  if (!record.ok()) return record.status();
  if (!IsTerminal(record->state)) {
    return WrongState(id, record->state, "delete", "SUCCEEDED, FAILED or CANCELLED (cancel it first)");
  }
  if (absl::Status status = CheckEtag(*record, etag); !status.ok()) return status;
  if (absl::Status status = store_.ok_for_now(); !status.ok()) return status;
  std::promise<absl::Status> deleted;
  store_.DeleteJob(id, [&deleted](absl::Status status) { deleted.set_value(std::move(status)); });
  return deleted.get_future().get();
}

absl::StatusOr<Page<IterationRecord>> UseCases::ListIterations(const std::string& id, int page_size,
                                                               const std::string& page_token) {
  const auto size = PageSize(page_size, 1000, 10'000);
  if (!size.ok()) return size.status();
  const std::string list = absl::StrCat("iterations\n", id);
  int after = 0;
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, list, 1);
    if (!parts.ok()) return parts.status();
    (void)absl::SimpleAtoi(parts->at(0), &after);
  }
  auto records = store_.ListIterations(id, after, *size + 1);
  if (!records.ok()) return records.status();
  Page<IterationRecord> page{.items = *std::move(records)};
  if (page.items.size() > static_cast<std::size_t>(*size)) {
    page.items.pop_back();
    page.next_page_token = MakePageToken(list, {absl::StrCat(page.items.back().iteration)});
  }
  return page;
}

absl::StatusOr<Page<IterationRecord>> UseCases::SampleIterations(const std::string& id, int max_points, int first,
                                                                 int last) {
  if (max_points < 16 || max_points > 10'000) {
    return InvalidField("max_points", "0 or in [16, 10000]", max_points);
  }
  if (first < 0) return InvalidField("first_iteration", "0 (from the first) or at least 1", first);
  if (last != 0 && last < first) {
    return InvalidField("last_iteration", "0 (to the newest) or at least first_iteration", last);
  }
  IterationRange range{.first = std::max(first, 1)};
  if (last != 0) range.last = last;
  auto records = store_.SampleIterations(id, range, max_points);
  if (!records.ok()) return records.status();
  return Page<IterationRecord>{.items = *std::move(records)};
}

absl::StatusOr<Page<Scenario>> UseCases::ListScenarios(int page_size, const std::string& page_token) {
  const auto size = PageSize(page_size, 50, 1000);
  if (!size.ok()) return size.status();
  const auto presets = Presets();
  std::size_t begin = 0;
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, "scenarios", 1);
    if (!parts.ok()) return parts.status();
    (void)absl::SimpleAtoi(parts->at(0), &begin);
  }
  begin = std::min(begin, presets.size());
  const std::size_t end = std::min(begin + static_cast<std::size_t>(*size), presets.size());
  Page<Scenario> page{.items = {presets.begin() + static_cast<std::ptrdiff_t>(begin),
                                presets.begin() + static_cast<std::ptrdiff_t>(end)}};
  if (end < presets.size()) page.next_page_token = MakePageToken("scenarios", {absl::StrCat(end)});
  return page;
}

absl::StatusOr<Scenario> UseCases::GetScenario(const std::string& id) {
  const Scenario* preset = FindPreset(id);
  if (preset != nullptr) return *preset;
  return absl::NotFoundError(absl::StrCat("no scenario ", FormatReceived(id)));
}

absl::StatusOr<EpisodeAnswer> UseCases::SimulateEpisode(const EpisodeRequest& request,
                                                        const std::function<bool()>& cancelled) {
  auto scenario = Choose(request.scenario);
  if (!scenario.ok()) return scenario.status();
  FieldErrors errors;
  const Gains gains = request.gains.value_or(scenario->search.initial_gains);
  const std::string_view given =
      request.gains || !request.scenario.definition ? "gains" : "scenario_definition.hyperparameters.initial_gains";
  for (std::size_t i = 0; i < kGainCount; ++i) {
    if (!(gains[i] > 0 && gains[i] <= SearchOptions::kMaxGain)) {
      errors.AddNumber(absl::StrCat(ToAbsl(given), ".k", i + 1), absl::StrCat("in (0, ", SearchOptions::kMaxGain, "]"),
                       gains[i]);
    }
  }
  if (request.sample_stride < 0) errors.AddNumber("sample_stride", ">= 0 (0: 1)", request.sample_stride);
  if (!errors.empty()) return errors.ToStatus();
  auto prepared = Prepare(*scenario, request.initial_condition);
  if (!prepared.ok()) return prepared.status();

  EpisodeAnswer answer{.prepared = *std::move(prepared)};
  std::vector<EpisodeSample> samples;
  const EpisodeResult result = orbitune::SimulateEpisode(answer.prepared.problem, gains,
                                                         {.early_exit = request.early_exit,
                                                          .measure_effort = true,
                                                          .trajectory = request.include_trajectory ? &samples : nullptr,
                                                          .cancelled = cancelled});
  if (cancelled && cancelled()) return absl::CancelledError("nobody waits for the episode any more");
  answer.report = ToReport(result, answer.prepared);
  const auto stride = static_cast<std::size_t>(std::max(request.sample_stride, 1));
  for (std::size_t i = 0; i < samples.size(); i += stride) answer.trajectory.push_back(samples[i]);
  return answer;
}

}  // namespace orbitune
