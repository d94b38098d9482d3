// The one file that sees CLI11: it takes seconds to compile.
#include "client/cli/app.h"

#include <algorithm>
#include <memory>

#include "CLI/CLI.hpp"
#include "client/cli/campaign_commands.h"
#include "client/cli/commands.h"
#include "client/cli/completion.h"
#include "client/cli/connection.h"
#include "client/cli/errors.h"
#include "client/cli/gains_commands.h"
#include "client/cli/number.h"
#include "client/cli/session.h"

namespace orbitune::cli {
namespace {

constexpr char kFooter[] = R"help(
Examples:
  orbitune scenarios                                    what there is to fly
  orbitune submit --scenario gto-geo --seed 7 --watch   tune, and follow the progress
  orbitune submit --scenario gto-geo --iterations 500 --label case=1 \
      --ic semi_major_axis_km=24364,eccentricity=0.7306,inclination_deg=63,raan_deg=75,argument_of_periapsis_deg=158
  orbitune --json scenarios gto-geo > mine.json         a scenario to edit, then
  orbitune submit --scenario-file mine.json
  orbitune jobs --state running --label case=1
  orbitune watch JOB                                    Ctrl-C ends the watching, not the job
  orbitune history JOB -o history.csv
  orbitune verify JOB                                   run it again: is it the same, bit for bit?
  orbitune gains query --scenario leo-rendezvous --ic new.json --refine
  orbitune gains export JOB --format c-header -o gains.h
  orbitune simulate --job JOB --which best --csv trajectory.csv
  orbitune campaign create --scenario leo-rendezvous --count 50 --seed 7 --held-out 50 --robust --watch
  orbitune report campaigns/ID -o report.html           figures and tables, in one page
  eval "$(orbitune completion bash)"                    completion in this shell
  orbitune --server https://HOST:7313 --token-file ~/.orbitune-token whoami

Initial conditions (--ic): a JSON file of an OrbitState, or all keys of one of
  semi_major_axis_km, eccentricity, inclination_deg, raan_deg, argument_of_periapsis_deg,
      and true_anomaly_deg, true_longitude_deg or neither (at the periapsis)
  p_km, ex, ey, hx, hy, true_longitude_deg
  x_km, y_km, z_km, x_dot_km_s, y_dot_km_s, z_dot_km_s

Exit codes:
  0    success
  1    the job watched ended FAILED or CANCELLED; the episode left the domain or failed; the job verified differs
  2    usage, a bad local file, INVALID_ARGUMENT
  3    not found
  4    the server cannot be reached, or did not answer in time
  5    refused in this state (FAILED_PRECONDITION, ALREADY_EXISTS, ABORTED)
  6    any other error of the server
  7    a token is needed, or another one (UNAUTHENTICATED, PERMISSION_DENIED)
  130  interrupted

"orbitune COMMAND --help" tells a command's options, "orbitune --help-all" those of all.)help";

using Run = std::function<int(Session&)>;

// A subcommand whose options live as long as the parser; `run` is set when it is the one chosen.
template <typename Options>
struct Command {
  CLI::App* app;
  std::shared_ptr<Options> options = std::make_shared<Options>();
};

template <typename Options>
Command<Options> AddCommand(CLI::App& program, Run& run, const char* name, const char* help,
                            int (*command)(Session&, const Options&)) {
  Command<Options> added{program.add_subcommand(name, help)};
  added.app->callback([&run, command, options = added.options] {
    run = [command, options](Session& session) { return command(session, *options); };
  });
  return added;
}

// CLI11's own conversion goes through long double; this one gives the nearest double, NaN and infinity included.
template <typename T, typename Target>
CLI::Option* AddNumber(CLI::App& app, const std::string& flag, Target& target, const std::string& help) {
  const auto assign = [&target, flag](const std::string& text) {
    const absl::StatusOr<T> value = ParseNumber<T>(text);
    if (!value.ok()) throw CLI::ValidationError(flag, std::string(value.status().message()));
    target = *value;
  };
  return app.add_option_function<std::string>(flag, assign, help)->type_name("NUMBER");
}

CLI::Option* AddText(CLI::App& app, const std::string& flag, std::string& target, const std::string& help,
                     const std::string& kind) {
  return app.add_option(flag, target, help)->type_name(kind);
}

void AddLabels(CLI::App& app, std::vector<std::string>& target, const std::string& help) {
  app.add_option("--label", target, help)->type_name("KEY=VALUE")->allow_extra_args(false)->take_all();
}

void AddScenario(CLI::App& app, FlightOptions& flight) {
  CLI::Option* const name = AddText(app, "--scenario", flight.scenario, "A built-in scenario", "SCENARIO");
  CLI::Option* const file = AddText(app, "--scenario-file", flight.scenario_file, "A Scenario in JSON", "FILE");
  name->excludes(file);
}

void AddFlight(CLI::App& app, FlightOptions& flight) {
  AddScenario(app, flight);
  AddText(app, "--ic", flight.initial_condition,
          "The chaser's orbit instead of the scenario's: FILE.json or KEY=VALUE,... (see orbitune --help)", "FILE");
}

void AddReconnect(CLI::App& app, double& target) {
  AddNumber<double>(app, "--reconnect-seconds", target,
                    "How long to try to reconnect when the server goes away while watching; 0: not at all [60]");
}

void AddScenarios(CLI::App& program, Run& run) {
  const auto [app, options] =
      AddCommand(program, run, "scenarios", "List the built-in scenarios, or show one", RunScenarios);
  AddText(*app, "NAME", options->name, "Show this one; with --json as a file for --scenario-file", "SCENARIO");
}

void AddWhoami(CLI::App& program, Run& run) {
  program.add_subcommand("whoami", "Whose the token is, and what it may do")->callback([&run] { run = RunWhoami; });
}

void AddSearch(CLI::App& app, SearchFlags& flags) {
  AddText(app, "--algorithm", flags.algorithm, "[ars]", "ars|cma-es|nelder-mead");
  AddNumber<std::int64_t>(
      app, "--max-episodes", flags.max_episodes,
      "At most so many; 0: no bound but --iterations [ars: 0; else 6000 for each initial condition]");
  AddNumber<std::int32_t>(app, "--plateau", flags.plateau_iterations,
                          "End when the best cost has not fallen for so many iterations; 0: never [0]");
  AddNumber<double>(app, "--plateau-improvement", flags.plateau_improvement,
                    "By this part of itself, to count as fallen [0.001]");
  AddNumber<std::int32_t>(app, "--top-directions", flags.top_directions,
                          "ars: only the so many best directions move K; 0: all [0]");
  AddText(app, "--step-schedule", flags.step_schedule, "ars: how alpha falls [constant]",
          "constant|linear|inverse-sqrt");
  AddText(app, "--exploration-schedule", flags.exploration_schedule, "ars: how sigma falls [constant]",
          "constant|linear|inverse-sqrt");
  app.add_flag("--log-gains", flags.log_gains, "ars: over the logarithm of the gains");
  AddNumber<std::int32_t>(app, "--population", flags.population, "cma-es: candidates in a generation");
  AddNumber<double>(app, "--initial-sigma", flags.initial_sigma, "cma-es: standard deviation of ln K at the start");
  AddNumber<double>(app, "--population-growth", flags.population_growth,
                    "cma-es: population of a run over that of the one before");
  AddNumber<double>(app, "--initial-step", flags.initial_step, "nelder-mead: edge of the first simplex in ln K");
  AddNumber<std::int32_t>(app, "--restarts", flags.restarts, "cma-es, nelder-mead: runs after the first");
}

// What a job and a campaign are told alike, beside what is flown.
void AddTuning(CLI::App& program, SubmitOptions& submit) {
  CLI::App* const app = &program;
  SubmitOptions* const options = &submit;
  AddText(*app, "--name", options->display_name, "A title", "TEXT");
  AddLabels(*app, options->labels, "A label; may be repeated");
  app->add_option("--priority", options->priority,
                  "-4 to 4: of your own jobs the highest begins first, and gets 2^priority parts of your time [0]");
  AddNumber<std::int32_t>(*app, "--iterations", options->iterations, "M; like all below, the scenario's if not given");
  AddNumber<double>(*app, "--step-size", options->step_size, "alpha");
  AddNumber<double>(*app, "--exploration-scale", options->exploration_scale, "sigma");
  AddNumber<std::int32_t>(*app, "--directions", options->directions, "N");
  AddText(*app, "--initial-gains", options->initial_gains, "K(1)", "K1,K2,K3,K4,K5");
  AddText(*app, "--exploration-std", options->exploration_std, "Standard deviation of each gain's exploration",
          "S1,S2,S3,S4,S5");
  AddNumber<double>(*app, "--gain-floor", options->gain_floor, "No gain simulated is smaller");
  AddNumber<std::uint64_t>(*app, "--seed", options->seed, "Of the random numbers");
  AddSearch(*app, options->search);
  AddText(*app, "--warm-start", options->warm_start, "Begin with the best gains of a job or a gain set",
          "jobs/ID|gainSets/ID")
      ->excludes(app->get_option("--initial-gains"));
  AddText(*app, "--request-id", options->request_id,
          "The same id and the same request again give what was created before [a random UUID]", "ID");
  CLI::Option* const validate = app->add_flag("--validate-only", options->validate_only, "Check; store nothing");
  app->add_flag("--watch", options->watch, "Then watch it")->excludes(validate);
  AddReconnect(*app, options->reconnect_s);
}

void AddSubmit(CLI::App& program, Run& run) {
  const auto [app, options] = AddCommand(program, run, "submit", "Create a tuning job", RunSubmit);
  AddFlight(*app, options->flight);
  AddText(*app, "--ics", options->initial_conditions_file,
          "Robust tuning: one K for all of these; FILE.csv or FILE.json", "FILE")
      ->excludes(app->get_option("--ic"));
  AddText(*app, "--objective", options->objective, "What their costs are made into [mean]",
          "mean|worst|percentile:LEVEL|cvar:LEVEL")
      ->needs(app->get_option("--ics"));
  app->add_flag("--relative", options->relative, "Of J / J(K(1)) of each instead of J")
      ->needs(app->get_option("--ics"));
  AddTuning(*app, *options);
}

void AddWatch(CLI::App& program, Run& run) {
  const auto [app, options] =
      AddCommand(program, run, "watch", "Follow a job to its end; Ctrl-C leaves it running", RunWatch);
  AddText(*app, "JOB", options->job, "ID or jobs/ID", "JOB")->required();
  app->add_flag("--every", options->every, "A line per iteration on a terminal, too, as into a pipe");
  AddNumber<std::int64_t>(*app, "--from", options->from,
                          "Only events after this sequence number; 0: all, -1: only new ones");
  AddReconnect(*app, options->reconnect_s);
}

void AddJobs(CLI::App& program, Run& run) {
  const auto [app, options] = AddCommand(program, run, "jobs", "List jobs", RunJobs);
  AddText(*app, "--filter", options->filter,
          "Comparisons joined by AND: state = RUNNING, scenario = \"gto-geo\", labels.KEY != \"value\"", "EXPRESSION");
  AddText(*app, "--state", options->state, "Only jobs in this state",
          "queued|running|paused|succeeded|failed|cancelled");
  AddLabels(*app, options->labels, "Only jobs with this label; may be repeated");
  AddText(*app, "--scenario", options->scenario, "Only jobs of this scenario", "SCENARIO");
  AddText(*app, "--order-by", options->order_by, "create_time or best_cost, with or without \" desc\"", "FIELD");
  AddNumber<std::int64_t>(*app, "--limit", options->limit, "At most so many; 0: all [0]");
}

void AddShow(CLI::App& program, Run& run) {
  const auto [app, job] = AddCommand(program, run, "show", "Show a job, and what it came to", RunShow);
  AddText(*app, "JOB", *job, "ID or jobs/ID", "JOB")->required();
}

void AddHistory(CLI::App& program, Run& run) {
  const auto [app, options] = AddCommand(program, run, "history", "Every iteration of a job", RunHistory);
  AddText(*app, "JOB", options->job, "ID or jobs/ID", "JOB")->required();
  AddText(*app, "--format", options->format, "[csv]", "csv|json")
      ->check(CLI::IsMember({"csv", "json"}).description(""));
  AddText(*app, "--output,-o", options->output, "Into this file, which appears whole or not at all [stdout]", "FILE");
}

void AddVerify(CLI::App& program, Run& run) {
  const auto [app, options] =
      AddCommand(program, run, "verify", "Run a job again and compare it with what is stored, bit for bit", RunVerify);
  AddText(*app, "JOB", options->job, "ID or jobs/ID", "JOB")->required();
  AddNumber<std::int32_t>(*app, "--from", options->from, "The first iteration to run again [1]");
  AddNumber<std::int32_t>(*app, "--to", options->to, "The last one [the newest]");
}

void AddTransition(CLI::App& program, Run& run, const char* name, const char* help, Transition transition) {
  CLI::App* const app = program.add_subcommand(name, help);
  const auto jobs = std::make_shared<std::vector<std::string>>();
  app->add_option("JOB", *jobs, "ID or jobs/ID")->type_name("JOB")->required();
  app->callback([&run, jobs, transition] {
    run = [jobs, transition](Session& session) { return RunTransition(session, transition, *jobs); };
  });
}

void AddTransitions(CLI::App& program, Run& run) {
  AddTransition(program, run, "cancel", "End jobs; what was stored stays", Transition::kCancel);
  AddTransition(program, run, "pause", "Halt jobs", Transition::kPause);
  AddTransition(program, run, "resume", "Let paused jobs go on", Transition::kResume);
  AddTransition(program, run, "delete", "Delete jobs that have ended, and their history", Transition::kDelete);
}

void AddSimulate(CLI::App& program, Run& run) {
  const auto [app, options] = AddCommand(program, run, "simulate", "Fly one episode", RunSimulate);
  AddFlight(*app, options->flight);
  CLI::Option* const job = AddText(*app, "--job", options->job, "What this job flies, with its gains", "JOB");
  job->excludes(app->get_option("--scenario"))->excludes(app->get_option("--scenario-file"));
  AddText(*app, "--which", options->which, "Which of the job's gains [best]", "initial|final|best")
      ->check(CLI::IsMember({"initial", "final", "best"}).description(""))
      ->needs(job);
  AddText(*app, "--gains", options->gains, "Other gains than the scenario's or the job's", "K1,K2,K3,K4,K5")
      ->excludes(app->get_option("--which"));
  AddText(*app, "--csv", options->csv, "Write the trajectory; - is stdout", "FILE");
  AddNumber<std::int32_t>(*app, "--stride", options->stride, "Only every n-th sample of it");
  app->add_flag("--early-exit", options->early_exit, "Stop once settling is proven; the cost is the same");
  app->add_flag("--trajectory", options->trajectory, "With --json: the trajectory, too");
}

void AddInitialConditions(CLI::App& app, InitialConditionOptions& options) {
  CLI::Option* const file =
      AddText(app, "--ics", options.file, "Initial conditions to tune for: FILE.csv or FILE.json", "FILE");
  CLI::Option* const count =
      AddNumber<std::int32_t>(app, "--count", options.count, "How many to draw instead, from the scenario's own");
  AddText(app, "--distribution", options.distribution, "Draw from this one instead: an IcDistribution in JSON", "FILE")
      ->needs(count);
  AddNumber<std::uint64_t>(app, "--ic-seed", options.seed, "Of the draws [--seed]")->needs(count);
  file->excludes(count);
}

void AddCampaignCreate(CLI::App& campaign, Run& run) {
  const auto [app, options] =
      AddCommand(campaign, run, "create", "Tune for many initial conditions, and compare gains for all of them",
                 RunCampaignCreate);
  AddScenario(*app, options->job.flight);
  AddInitialConditions(*app, options->initial_conditions);
  CLI::Option* const held_out = AddNumber<std::int32_t>(
      *app, "--held-out", options->held_out_count, "Draw so many more, to compare gains on and never to tune with");
  CLI::Option* const held_out_file =
      AddText(*app, "--held-out-ics", options->held_out_file, "Take these instead: FILE.csv or FILE.json", "FILE");
  held_out->excludes(held_out_file);
  app->add_flag("--tune-held-out", options->tune_held_out, "Tune each of these, too, as something to compare with");
  app->add_flag("--robust", options->robust, "Also look for one K for all initial conditions, by CMA-ES");
  AddText(*app, "--robust-objective", options->robust_objective,
          "Of J / J(K(1)) over them: mean, worst, percentile:LEVEL or cvar:LEVEL [mean]", "OBJECTIVE");
  AddNumber<std::int64_t>(*app, "--robust-episodes", options->robust_episodes,
                          "How many it may fly [6000 for each initial condition]");
  AddTuning(*app, options->job);
}

void AddCampaignExtend(CLI::App& campaign, Run& run) {
  const auto [app, options] =
      AddCommand(campaign, run, "extend", "Add initial conditions to a campaign that has ended", RunCampaignExtend);
  AddText(*app, "CAMPAIGN", options->campaign, "ID or campaigns/ID", "CAMPAIGN")->required();
  AddInitialConditions(*app, options->initial_conditions);
  AddText(*app, "--request-id", options->request_id,
          "The same id and the same request again extend it once [a random UUID]", "ID");
  app->add_flag("--watch", options->watch, "Then watch it");
  AddReconnect(*app, options->reconnect_s);
}

void AddCampaignExport(CLI::App& campaign, Run& run) {
  const auto [app, options] = AddCommand(
      campaign, run, "export", "Every initial condition with its gains and what they give", RunCampaignExport);
  AddText(*app, "CAMPAIGN", options->campaign, "ID or campaigns/ID", "CAMPAIGN")->required();
  AddText(*app, "--format", options->format, "[csv]", "csv|json")
      ->check(CLI::IsMember({"csv", "json"}).description(""));
  AddText(*app, "--output,-o", options->output, "Into this file, which appears whole or not at all [stdout]", "FILE");
}

void AddCampaignNames(CLI::App& campaign, Run& run) {
  const auto [show, shown] = AddCommand(campaign, run, "show", "Show a campaign, and what it came to", RunCampaignShow);
  AddText(*show, "CAMPAIGN", *shown, "ID or campaigns/ID", "CAMPAIGN")->required();
  const auto [members, listed] =
      AddCommand(campaign, run, "members", "List its initial conditions and their jobs", RunCampaignMembers);
  AddText(*members, "CAMPAIGN", *listed, "ID or campaigns/ID", "CAMPAIGN")->required();
  const auto [watch, watched] =
      AddCommand(campaign, run, "watch", "Follow a campaign to its end; Ctrl-C leaves it running", RunCampaignWatch);
  AddText(*watch, "CAMPAIGN", watched->campaign, "ID or campaigns/ID", "CAMPAIGN")->required();
  AddNumber<std::int64_t>(*watch, "--from", watched->from,
                          "Only events after this sequence number; 0: all, -1: only new ones");
  AddReconnect(*watch, watched->reconnect_s);
}

void AddCampaignTransition(CLI::App& campaign, Run& run, const char* name, const char* help, Transition transition) {
  CLI::App* const app = campaign.add_subcommand(name, help);
  const auto campaigns = std::make_shared<std::vector<std::string>>();
  app->add_option("CAMPAIGN", *campaigns, "ID or campaigns/ID")->type_name("CAMPAIGN")->required();
  app->callback([&run, campaigns, transition] {
    run = [campaigns, transition](Session& session) { return RunCampaignTransition(session, transition, *campaigns); };
  });
}

void AddCampaign(CLI::App& program, Run& run) {
  CLI::App& campaign = *program.add_subcommand("campaign", "Tune for many initial conditions");
  campaign.require_subcommand(1);
  AddCampaignCreate(campaign, run);
  const auto [list, options] = AddCommand(campaign, run, "list", "List campaigns", RunCampaignList);
  AddText(*list, "--state", options->state, "Only those in this state",
          "running|paused|evaluating|succeeded|failed|cancelled");
  AddNumber<std::int64_t>(*list, "--limit", options->limit, "At most so many; 0: all [0]");
  AddCampaignNames(campaign, run);
  AddCampaignTransition(campaign, run, "pause", "Halt campaigns with all their jobs", Transition::kPause);
  AddCampaignTransition(campaign, run, "resume", "Let paused campaigns go on", Transition::kResume);
  AddCampaignTransition(campaign, run, "cancel", "End campaigns; what was stored stays", Transition::kCancel);
  AddCampaignTransition(campaign, run, "delete", "Delete campaigns that have ended, with all their jobs",
                        Transition::kDelete);
  AddCampaignExtend(campaign, run);
  AddCampaignExport(campaign, run);
}

void AddReport(CLI::App& program, Run& run) {
  const auto [app, options] =
      AddCommand(program, run, "report", "Figures and tables of a job or a campaign, in one page that needs no network",
                 RunReport);
  AddText(*app, "NAME", options->name, "jobs/ID or campaigns/ID", "NAME")->required();
  AddText(*app, "--output,-o", options->output, "The HTML file, which appears whole or not at all; - is stdout", "FILE")
      ->required();
}

void DescribeOptions(const CLI::App& app, CommandSpec& spec) {
  for (const CLI::Option* const option : app.get_options()) {
    OptionSpec described;
    for (const std::string& name : option->get_snames()) described.flags.push_back("-" + name);
    for (const std::string& name : option->get_lnames()) described.flags.push_back("--" + name);
    if (option->get_items_expected_max() > 0) described.value = option->get_type_name();
    spec.options.push_back(described);
  }
}

// A group of commands, as `campaign`, is described as one: its first word is one of theirs, and its options all of
// theirs.
void AddGainsQuery(CLI::App& gains, Run& run) {
  const auto [app, options] = AddCommand(
      gains, run, "query", "Which gains for this initial condition? Flies candidates from the library", RunGainsQuery);
  AddFlight(*app, options->flight);
  AddNumber<std::int32_t>(*app, "--max-candidates", options->max_candidates, "To fly [64]");
  AddNumber<std::int32_t>(*app, "--max-answers", options->max_answers, "[5]");
  app->add_flag("--refine{100}", options->refine_ms,
                "Then search on from the best for so many milliseconds: =MS [100]");
}

void AddGainsSelection(CLI::App& app, GainsListOptions& options) {
  AddText(app, "--filter", options.filter,
          "Comparisons joined by AND: kind = TUNED, scenario = \"gto-geo\", job = JOB, campaign = CAMPAIGN",
          "EXPRESSION");
  AddText(app, "--scenario", options.scenario, "Only of this scenario", "SCENARIO");
  AddText(app, "--kind", options.kind, "Only of this kind", "tuned|robust|mean|imported");
  AddNumber<std::int64_t>(app, "--limit", options.limit, "At most so many, the newest; 0: all [0]");
}

void AddGainsExport(CLI::App& gains, Run& run) {
  const auto [app, options] =
      AddCommand(gains, run, "export", "Gain sets as CSV or JSON, or one as a C header", RunGainsExport);
  AddText(*app, "NAME", options->which.name, "This one: ID or gainSets/ID (a job's gain set has the job's ID)",
          "GAINS");
  AddGainsSelection(*app, options->which);
  AddText(*app, "--format", options->format, "[csv]", "csv|json|c-header")
      ->check(CLI::IsMember({"csv", "json", "c-header"}).description(""));
  AddText(*app, "--output,-o", options->output, "Into this file, which appears whole or not at all [stdout]", "FILE");
}

void AddGainsImport(CLI::App& gains, Run& run) {
  const auto [app, options] =
      AddCommand(gains, run, "import", "Store gain sets from a file, all or none, each flown first", RunGainsImport);
  AddText(*app, "FILE", options->file, "What `gains export` wrote: FILE.csv or FILE.json", "FILE")->required();
  AddText(*app, "--scenario-file", options->scenario_file, "The Scenario in JSON of those without a definition",
          "FILE");
  app->add_flag("--validate-only", options->validate_only, "Check and fly; store nothing");
}

void AddGains(CLI::App& program, Run& run) {
  CLI::App& gains = *program.add_subcommand("gains", "The gain library: gains tuned before, for a new start");
  gains.require_subcommand(1);
  AddGainsQuery(gains, run);
  const auto [list, options] = AddCommand(gains, run, "list", "List gain sets", RunGainsList);
  AddGainsSelection(*list, *options);
  const auto [show, shown] = AddCommand(gains, run, "show", "Show a gain set", RunGainsShow);
  AddText(*show, "NAME", *shown, "ID or gainSets/ID", "GAINS")->required();
  AddGainsExport(gains, run);
  AddGainsImport(gains, run);
  const auto [remove, names] = AddCommand(gains, run, "delete", "Delete gain sets", RunGainsDelete);
  remove->add_option("NAME", *names, "ID or gainSets/ID")->type_name("GAINS")->required();
}

CommandSpec Describe(const CLI::App& app) {
  const bool program = app.get_parent() == nullptr;
  CommandSpec spec{program ? "" : app.get_name(), {}};
  DescribeOptions(app, spec);
  if (program) return spec;
  OptionSpec verbs;
  for (const CLI::App* const command : app.get_subcommands({})) {
    verbs.value += (verbs.value.empty() ? "" : "|") + command->get_name();
    DescribeOptions(*command, spec);
  }
  if (!verbs.value.empty()) spec.options.insert(spec.options.begin(), verbs);
  return spec;
}

void AddCompletion(CLI::App& program, Run& run, const std::shared_ptr<std::string>& shell) {
  CLI::App* const app = program.add_subcommand("completion", "Print a completion script");
  AddText(*app, "SHELL", *shell, "bash", "bash")->required()->check(CLI::IsMember({"bash"}).description(""));
  app->callback([&program, &run] {
    std::vector<CommandSpec> commands = {Describe(program)};
    for (const CLI::App* const command : program.get_subcommands({})) commands.push_back(Describe(*command));
    run = [commands](Session& session) {
      session.out() << BashCompletion(commands);
      return kExitOk;
    };
  });
}

void AddGlobals(CLI::App& program, Globals& globals) {
  AddText(program, "--server", globals.server, "Where the server listens [127.0.0.1:7313]; https://HOST:PORT: TLS",
          "HOST:PORT")
      ->envname("ORBITUNE_SERVER");
  AddText(program, "--token-file", globals.token_file,
          "A file, nobody else's to read, with the token that the server asks for [the environment's ORBITUNE_TOKEN]",
          "FILE")
      ->envname("ORBITUNE_TOKEN_FILE");
  AddText(program, "--tls-ca", globals.tls_ca, "Authorities that the server's certificate may come from [the system's]",
          "FILE")
      ->envname("ORBITUNE_TLS_CA");
  CLI::Option* const cert = AddText(program, "--tls-cert", globals.tls_cert,
                                    "A certificate of one's own, where the server asks for one", "FILE")
                                ->envname("ORBITUNE_CLIENT_CERT");
  CLI::Option* const key =
      AddText(program, "--tls-key", globals.tls_key, "Its key", "FILE")->envname("ORBITUNE_CLIENT_KEY");
  cert->needs(key);
  key->needs(cert);
  program.add_flag("--insecure", globals.insecure, "Send the token even where others can read what passes");
  program.add_flag("--json", globals.json, "JSON on stdout (a line per row or event) and, for errors, on stderr");
  AddNumber<double>(program, "--timeout", globals.timeout_s, "Seconds to wait for an answer [30]")
      ->check([](const std::string& text) -> std::string {
        const absl::StatusOr<double> value = ParseNumber<double>(text);
        return value.ok() && *value > 0 && *value <= 1e6 ? "" : "must be above 0 and at most 1e6 seconds";
      });
  program.set_version_flag("--version", std::string("orbitune ") + ORBITUNE_VERSION);
  program.require_subcommand(1);
  program.fallthrough();  // the global options may come after the command, too
}

int UsageError(const CLI::App& program, const CLI::ParseError& error, bool json, const Terminal& terminal) {
  if (error.get_exit_code() == 0) return program.exit(error, *terminal.out, *terminal.err);
  *terminal.err << RenderError({grpc::StatusCode::INVALID_ARGUMENT, error.what()}, json);
  if (!json) *terminal.err << "  `orbitune --help` and `orbitune COMMAND --help` tell what there is\n";
  return kExitUsage;
}

}  // namespace

int RunCli(const std::vector<std::string>& arguments, const Terminal& terminal) {
  CLI::App program("Tunes orbital tracking controllers: the client of the Orbitune server.", "orbitune");
  Globals globals;
  Run run;
  const auto shell = std::make_shared<std::string>();
  AddGlobals(program, globals);
  AddScenarios(program, run);
  AddSubmit(program, run);
  AddWatch(program, run);
  AddJobs(program, run);
  AddShow(program, run);
  AddHistory(program, run);
  AddVerify(program, run);
  AddTransitions(program, run);
  AddSimulate(program, run);
  AddCampaign(program, run);
  AddGains(program, run);
  AddReport(program, run);
  AddWhoami(program, run);
  AddCompletion(program, run, shell);
  // Now that the commands are there, which would inherit them.
  program.set_help_all_flag("--help-all", "The help of every command");
  program.footer(kFooter);
  try {
    program.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));  // CLI11 wants them reversed
  } catch (const CLI::ParseError& error) {
    const bool json = std::find(arguments.begin(), arguments.end(), "--json") != arguments.end();
    return UsageError(program, error, json, terminal);
  }
  const auto channel = Connect(globals);
  if (!channel.ok()) {
    *terminal.err << RenderError(ToGrpcStatus(channel.status()), globals.json);
    return kExitUsage;
  }
  Session session(globals, terminal, *channel);
  return run(session);
}

}  // namespace orbitune::cli
