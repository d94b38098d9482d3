// The gain library in memory: which stored gains were tuned nearest to a new start. One index over the error
// coordinates x(0) for each scenario digest; what a gain set holds beyond its gains is the store's.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/library/gain_set.h"

namespace orbitune {

// What the library keeps of a gain set.
struct LibraryEntry {
  std::string id;
  GainSetKind kind = GainSetKind::kTuned;
  Gains gains{};
  std::optional<ErrorState> initial_error;  // none: for several initial conditions
};

LibraryEntry ToLibraryEntry(const GainSet& set);

// Where a start lies with respect to a library, in units of the library's spread: for each coordinate of x(0) the
// standard deviation over the library, but no less than the settling distance (in p_r), within which all is alike.
struct LibraryPosition {
  std::size_t library_size = 0;  // gain sets, wherever they were flown from
  std::size_t located = 0;       // of them with an x(0); the distances are to these, NaN where there is none
  double nearest_distance = kUnset;
  double centre_distance = kUnset;   // to their mean
  double typical_distance = kUnset;  // nine in ten of them are nearer than this to their own nearest neighbour
  // Farther from the nearest one than kExtrapolationFactor times typical_distance; or the library has a single place.
  bool extrapolated = true;
};

inline constexpr double kExtrapolationFactor = 2;

// The gain sets of one scenario digest. Thread-safe: reads run side by side, and wait for no index being built.
class ScenarioLibrary {
 public:
  // settling_distance: in units of p_r, > 0.
  explicit ScenarioLibrary(double settling_distance);
  ~ScenarioLibrary();
  ScenarioLibrary(const ScenarioLibrary&) = delete;
  ScenarioLibrary& operator=(const ScenarioLibrary&) = delete;

  // Ids that are there already are left as they are.
  void Add(std::span<const LibraryEntry> entries);
  void Remove(const std::string& id);

  struct Neighbour {
    LibraryEntry entry;
    double distance = kUnset;  // as LibraryPosition's
  };
  struct Neighbourhood {
    LibraryPosition position;
    std::vector<Neighbour> nearest;     // ascending by distance
    std::vector<LibraryEntry> general;  // those without x(0), the newest first
    std::optional<Gains> mean;          // geometric, of all located
  };
  // At most so many of each.
  Neighbourhood Around(const ErrorState& x, std::size_t most_nearest, std::size_t most_general) const;

  std::size_t size() const;

 private:
  struct Index;  // of the located entries up to a moment
  struct Place {
    enum class In { kIndex, kRecent, kGeneral } in = In::kRecent;
    std::size_t at = 0;  // but for kGeneral
  };

  void AddOne(const LibraryEntry& entry);
  void RemoveFrom(const Place& place, const std::string& id);
  void RebuildIfWorthwhile();
  void Rebuild();
  void CountGains(const Gains& gains, int sign);
  LibraryPosition PositionOf(double nearest_distance, double centre_distance) const;

  const double settling_distance_;

  std::mutex changing_;                            // held by Add and Remove, before mutex_
  std::unordered_map<std::string, Place> places_;  // guarded by changing_

  mutable std::shared_mutex mutex_;
  // Changed with both mutexes held.
  std::shared_ptr<const Index> index_;
  std::vector<bool> removed_;  // of the index's entries, since it was built
  std::size_t removed_count_ = 0;
  std::vector<std::optional<LibraryEntry>> recent_;  // located, not in the index yet; none: removed
  std::vector<LibraryEntry> general_;
  std::size_t located_ = 0;
  std::array<double, kGainCount> log_gain_sums_{};  // over the located ones
};

// Thread-safe.
class GainLibrary {
 public:
  // definition: valid, any with this digest.
  void Add(const std::string& digest, const Scenario& definition, std::span<const LibraryEntry> entries);
  void Remove(const std::string& digest, const std::string& id);

  // Null where nothing was ever stored for it.
  std::shared_ptr<const ScenarioLibrary> Find(const std::string& digest) const;

  // None where nothing was ever stored for it.
  std::optional<Scenario> FindDefinition(const std::string& digest) const;

  // One for each digest with a gain set.
  std::vector<Scenario> Definitions() const;

 private:
  struct Shelf {
    Scenario definition;
    std::shared_ptr<ScenarioLibrary> library;
  };

  mutable std::shared_mutex mutex_;
  std::map<std::string, Shelf> shelves_;  // guarded by mutex_
};

}  // namespace orbitune
