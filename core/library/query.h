// "Which gains for this new start?": candidates from the library, each flown from the new start before it is answered.
#pragma once

#include "core/library/gain_library.h"
#include "core/library/refine.h"
#include "core/search/search.h"

namespace orbitune {

struct Candidate {
  enum class Source {
    kStored,        // a gain set
    kWeightedMean,  // of the nearest gain sets' gains: geometric, the nearer the heavier
    kLibraryMean,   // of all: geometric
    kInitial,       // the scenario's K(1)
    kRefined,       // searched for just now, from another candidate
  } source = Source::kInitial;
  Gains gains{};
  std::string gain_set_id;                 // of kStored
  GainSetKind kind = GainSetKind::kTuned;  // of kStored
  double distance = kUnset;                // from the new start, of kStored with a place (LibraryPosition)
};

struct QueryAnswer {
  Candidate candidate;
  Flight flight;  // from the new start
};

struct QueryOptions {
  int max_candidates = 64;  // to be flown, > 0
  int max_answers = 5;      // > 0
  static constexpr int kMostCandidates = 1024;
  static constexpr int kMostAnswers = 100;
};

struct Refined {
  std::int64_t episodes = 0;
  double elapsed_s = 0;
  bool improved = false;  // the first answer is of kRefined
};

struct QueryResult {
  LibraryPosition position;
  // The best first: settled before not settled before the rest, then by cost.
  std::vector<QueryAnswer> answers;
  std::optional<Refined> refined;  // where asked for
  int candidates = 0;              // flown, without those of the refinement
  int candidates_settled = 0;

  bool settled() const { return !answers.empty() && answers.front().flight.outcome == Outcome::kSettled; }
};

// At most max_candidates, none twice: the scenario's initial gains and the means first, then what is stored for
// several initial conditions, then the nearest. position is set beside. library: null for none.
std::vector<Candidate> ChooseCandidates(const ScenarioLibrary* library, const ErrorState& x, const Gains& initial_gains,
                                        const QueryOptions& options, LibraryPosition& position);

// Simulates one episode of the problem for each of the gains, as SimulateBatch does.
using Fly =
    std::function<void(const EpisodeProblem& problem, std::span<const Gains> gains, std::span<EpisodeResult> results)>;

// Flies every candidate from the prepared start, at a loose tolerance; the best ones again at the scenario's own, ranks
// them by what came out, and measures the answers' effort. prepared: of the new start.
QueryResult QueryLibrary(const ScenarioLibrary* library, const PreparedScenario& prepared, const Gains& initial_gains,
                         const QueryOptions& options, const Fly& fly);

// Searches on from the best answers, and puts what it finds first, if that is better than all. fly: thread-safe.
void RefineAnswers(const PreparedScenario& prepared, const RefineOptions& options, const Fly& fly,
                   std::size_t max_answers, QueryResult& query);

// The answer that these gains make, given their result by SimulateBatch: its cost and terms are that result's, its
// effort and certificate the scalar simulator's, flown until settling is proven, to seven digits.
QueryAnswer Measure(const PreparedScenario& prepared, const Candidate& candidate, const EpisodeResult& result);

}  // namespace orbitune
