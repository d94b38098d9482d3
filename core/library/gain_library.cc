#include "core/library/gain_library.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nanoflann.hpp>
#include <numbers>

#include "core/base/check.h"

namespace orbitune {
namespace {

constexpr std::size_t kCoordinates = 6;
using Point = std::array<double, kCoordinates>;

// Entries beyond the index are searched one by one. A new index is worthwhile from so many on, or from this fraction of
// what there is: the search one by one stays short, and building stays rare.
constexpr std::size_t kSmall = 256;
constexpr std::size_t kMostUnindexed = 4096;
constexpr std::size_t kIndexedPerUnindexed = 8;

const nanoflann::KDTreeSingleIndexAdaptorParams kTreeParameters(/*leaf_max_size=*/48);

// Stored starts whose nearest neighbours are looked up for LibraryPosition::typical_distance.
constexpr std::size_t kSampledForTypical = 128;
constexpr double kTypicalQuantile = 0.9;

// A longitude error of whole turns is none.
Point PointOf(const ErrorState& x) {
  return {std::remainder(x.x1, 2 * std::numbers::pi), x.x2, x.x3, x.x4, x.x5, x.x6};
}

Point Scaled(const Point& point, const Point& spread) {
  Point scaled;
  for (std::size_t i = 0; i < kCoordinates; ++i) scaled[i] = point[i] / spread[i];
  return scaled;
}

double SquaredDistance(const Point& a, const Point& b) {
  double sum = 0;
  for (std::size_t i = 0; i < kCoordinates; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

struct Found {
  double squared_distance;
  std::size_t item;

  auto operator<=>(const Found&) const = default;  // equals in the order they were added
};

// The k least of what is added, ascending; as nanoflann wants a result set to be.
class Nearest {
 public:
  using DistanceType = double;

  explicit Nearest(std::size_t k) : k_(k) { found_.reserve(k + 1); }

  bool addPoint(double squared_distance, std::size_t item) {
    const Found found{squared_distance, item};
    if (k_ == 0 || (full() && !(found < found_.back()))) return true;
    found_.insert(std::ranges::upper_bound(found_, found), found);
    if (found_.size() > k_) found_.pop_back();
    return true;
  }
  bool full() const { return found_.size() == k_; }
  std::size_t size() const { return found_.size(); }
  // Up to and including it a point may still belong here.
  double worstDist() const {
    return full() && k_ > 0 ? std::nextafter(found_.back().squared_distance, HUGE_VAL) : HUGE_VAL;
  }
  const std::vector<Found>& found() const { return found_; }

 private:
  const std::size_t k_;
  std::vector<Found> found_;
};

// Passes on what was not removed.
struct NearestAlive {
  using DistanceType = double;
  Nearest& nearest;
  const std::vector<std::size_t>& item_of;
  const std::vector<bool>& removed;

  bool addPoint(double squared_distance, std::size_t point) {
    const std::size_t item = item_of[point];
    return removed[item] || nearest.addPoint(squared_distance, item);
  }
  bool full() const { return nearest.full(); }
  std::size_t size() const { return nearest.size(); }
  double worstDist() const { return nearest.worstDist(); }
};

// The points as nanoflann reads them.
struct Cloud {
  std::vector<Point> points;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(std::size_t point, std::size_t coordinate) const { return points[point][coordinate]; }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, kCoordinates, std::size_t>;

Point MeanOf(const std::vector<Point>& points) {
  Point mean{};
  for (const Point& point : points) {
    for (std::size_t i = 0; i < kCoordinates; ++i) mean[i] += point[i] / static_cast<double>(points.size());
  }
  return mean;
}

Point SpreadOf(const std::vector<Point>& points, const Point& mean, double least) {
  Point variance{};
  for (const Point& point : points) {
    for (std::size_t i = 0; i < kCoordinates; ++i) {
      variance[i] += (point[i] - mean[i]) * (point[i] - mean[i]) / static_cast<double>(points.size());
    }
  }
  Point spread;
  for (std::size_t i = 0; i < kCoordinates; ++i) spread[i] = std::max(std::sqrt(variance[i]), least);
  return spread;
}

// Nine in ten of a sample of the points are nearer than this to another place; NaN where all are in one.
double TypicalDistance(const Cloud& cloud, const Tree& tree) {
  constexpr std::size_t kMostAtOnePlace = 16;
  constexpr double kOnePlace = 1e-18;  // squared
  const std::size_t count = cloud.points.size();
  const std::size_t stride = std::max<std::size_t>(count / kSampledForTypical, 1);
  std::vector<double> distances;
  for (std::size_t i = 0; i < count; i += stride) {
    Nearest nearest(kMostAtOnePlace);
    tree.findNeighbors(nearest, cloud.points[i].data(), nanoflann::SearchParams());
    const auto other =
        std::ranges::find_if(nearest.found(), [](const Found& f) { return f.squared_distance > kOnePlace; });
    if (other != nearest.found().end()) distances.push_back(std::sqrt(other->squared_distance));
  }
  if (distances.empty()) return kUnset;
  const auto quantile =
      distances.begin() + static_cast<std::ptrdiff_t>(kTypicalQuantile * static_cast<double>(distances.size() - 1));
  std::ranges::nth_element(distances, quantile);
  return *quantile;
}

}  // namespace

// Immutable.
struct ScenarioLibrary::Index {
  // located: each with its initial_error.
  Index(std::vector<LibraryEntry> located, double least_spread) : entries(std::move(located)) {
    std::vector<Point> points;
    for (const LibraryEntry& entry : entries) points.push_back(PointOf(*entry.initial_error));
    centre = MeanOf(points);
    spread = SpreadOf(points, centre, least_spread);
    for (const Point& point : points) cloud.points.push_back(Scaled(point, spread));
    if (points.empty()) return;
    // Points that a leaf holds side by side in memory, too: twice as fast a search.
    tree.emplace(kCoordinates, cloud, kTreeParameters);
    item_of = tree->vAcc;
    for (std::size_t i = 0; i < item_of.size(); ++i) cloud.points[i] = Scaled(points[item_of[i]], spread);
    tree.emplace(kCoordinates, cloud, kTreeParameters);
    typical_distance = TypicalDistance(cloud, *tree);
  }
  Index(const Index&) = delete;  // the tree points to the cloud
  Index& operator=(const Index&) = delete;

  const std::vector<LibraryEntry> entries;
  Point centre{};
  Point spread{};
  Cloud cloud;                       // scaled
  std::vector<std::size_t> item_of;  // the entry of each point
  std::optional<Tree> tree;
  double typical_distance = kUnset;
};

LibraryEntry ToLibraryEntry(const GainSet& set) {
  return {.id = set.id, .kind = set.kind, .gains = set.gains, .initial_error = set.initial_error};
}

ScenarioLibrary::ScenarioLibrary(double settling_distance) : settling_distance_(settling_distance) {
  ORBITUNE_CHECK(settling_distance > 0);
  Rebuild();
}

ScenarioLibrary::~ScenarioLibrary() = default;

std::size_t ScenarioLibrary::size() const {
  const std::shared_lock lock(mutex_);
  return located_ + general_.size();
}

// Both mutexes held, as in all that follows down to RebuildIfWorthwhile.
void ScenarioLibrary::CountGains(const Gains& gains, int sign) {
  located_ += static_cast<std::size_t>(sign);
  for (std::size_t i = 0; i < kGainCount; ++i) log_gain_sums_[i] += sign * std::log(gains[i]);
}

void ScenarioLibrary::AddOne(const LibraryEntry& entry) {
  const bool located = entry.initial_error.has_value();
  const Place place{.in = located ? Place::In::kRecent : Place::In::kGeneral, .at = recent_.size()};
  if (!places_.emplace(entry.id, place).second) return;
  if (!located) return general_.push_back(entry);
  recent_.emplace_back(entry);
  CountGains(entry.gains, 1);
}

void ScenarioLibrary::RemoveFrom(const Place& place, const std::string& id) {
  switch (place.in) {
    case Place::In::kIndex:
      removed_[place.at] = true;
      ++removed_count_;
      return CountGains(index_->entries[place.at].gains, -1);
    case Place::In::kRecent:
      CountGains(recent_[place.at]->gains, -1);
      return recent_[place.at].reset();
    case Place::In::kGeneral:
      std::erase_if(general_, [&](const LibraryEntry& entry) { return entry.id == id; });
  }
}

void ScenarioLibrary::Add(std::span<const LibraryEntry> entries) {
  const std::lock_guard changing(changing_);
  {
    const std::lock_guard lock(mutex_);
    for (const LibraryEntry& entry : entries) AddOne(entry);
  }
  RebuildIfWorthwhile();
}

void ScenarioLibrary::Remove(const std::string& id) {
  const std::lock_guard changing(changing_);
  const auto found = places_.find(id);
  if (found == places_.end()) return;
  {
    const std::lock_guard lock(mutex_);
    RemoveFrom(found->second, id);
  }
  places_.erase(found);
  RebuildIfWorthwhile();
}

// changing_ held.
void ScenarioLibrary::RebuildIfWorthwhile() {
  const std::size_t indexed = index_->entries.size();
  const std::size_t changes = recent_.size() + removed_count_;
  // A small library is indexed anew each time, so that its spread is what it is now.
  const bool small = indexed <= kSmall;
  if (changes > 0 && (small || changes >= std::min(kMostUnindexed, indexed / kIndexedPerUnindexed))) Rebuild();
}

// changing_ held. Readers go on with the old index until the new one is there.
void ScenarioLibrary::Rebuild() {
  std::vector<LibraryEntry> alive;
  alive.reserve(located_);
  for (std::size_t i = 0; i < removed_.size(); ++i) {
    if (!removed_[i]) alive.push_back(index_->entries[i]);
  }
  for (const auto& entry : recent_) {
    if (entry) alive.push_back(*entry);
  }
  std::shared_ptr<const Index> index = std::make_shared<const Index>(std::move(alive), settling_distance_);
  for (std::size_t i = 0; i < index->entries.size(); ++i) {
    places_[index->entries[i].id] = {.in = Place::In::kIndex, .at = i};
  }
  std::vector<bool> removed(index->entries.size());
  const std::lock_guard lock(mutex_);
  index_.swap(index);
  removed_.swap(removed);
  removed_count_ = 0;
  recent_.clear();
}

// mutex_ held.
LibraryPosition ScenarioLibrary::PositionOf(double nearest_distance, double centre_distance) const {
  const double typical = index_->typical_distance;
  return {.library_size = located_ + general_.size(),
          .located = located_,
          .nearest_distance = nearest_distance,
          .centre_distance = centre_distance,
          .typical_distance = typical,
          .extrapolated = !(nearest_distance <= (typical > 0 ? kExtrapolationFactor * typical : 1))};
}

ScenarioLibrary::Neighbourhood ScenarioLibrary::Around(const ErrorState& x, std::size_t most_nearest,
                                                       std::size_t most_general) const {
  const std::shared_lock lock(mutex_);
  const Index& index = *index_;
  const std::size_t indexed = index.entries.size();
  const Point scaled = Scaled(PointOf(x), index.spread);
  Nearest nearest(std::max<std::size_t>(most_nearest, 1));  // the position needs one
  if (index.tree) {
    NearestAlive results{nearest, index.item_of, removed_};
    index.tree->findNeighbors(results, scaled.data(), nanoflann::SearchParams());
  }
  for (std::size_t i = 0; i < recent_.size(); ++i) {
    if (!recent_[i]) continue;
    nearest.addPoint(SquaredDistance(scaled, Scaled(PointOf(*recent_[i]->initial_error), index.spread)), indexed + i);
  }

  Neighbourhood around{.position = PositionOf(kUnset, kUnset)};
  around.general.assign(general_.rbegin(),
                        general_.rbegin() + static_cast<std::ptrdiff_t>(std::min(most_general, general_.size())));
  if (located_ == 0) return around;
  for (const Found& found : nearest.found()) {
    const LibraryEntry& entry = found.item < indexed ? index.entries[found.item] : *recent_[found.item - indexed];
    around.nearest.push_back({entry, std::sqrt(found.squared_distance)});
  }
  around.position = PositionOf(around.nearest.front().distance,
                               std::sqrt(SquaredDistance(scaled, Scaled(index.centre, index.spread))));
  if (most_nearest == 0) around.nearest.clear();
  Gains& mean = around.mean.emplace();
  for (std::size_t i = 0; i < kGainCount; ++i) mean[i] = std::exp(log_gain_sums_[i] / static_cast<double>(located_));
  return around;
}

void GainLibrary::Add(const std::string& digest, const Scenario& definition, std::span<const LibraryEntry> entries) {
  std::shared_ptr<ScenarioLibrary> library;
  {
    const std::lock_guard lock(mutex_);
    Shelf& shelf = shelves_[digest];
    if (shelf.library == nullptr) {
      const auto target = Resolve(definition.target, definition.gravitational_parameter_km3_s2);
      ORBITUNE_CHECK(target.ok());
      shelf = {definition, std::make_shared<ScenarioLibrary>(definition.settling_distance_km / target->p)};
    }
    library = shelf.library;
  }
  library->Add(entries);
}

void GainLibrary::Remove(const std::string& digest, const std::string& id) {
  std::shared_ptr<ScenarioLibrary> library;
  {
    const std::shared_lock lock(mutex_);
    const auto found = shelves_.find(digest);
    if (found == shelves_.end()) return;
    library = found->second.library;
  }
  library->Remove(id);
}

std::shared_ptr<const ScenarioLibrary> GainLibrary::Find(const std::string& digest) const {
  const std::shared_lock lock(mutex_);
  const auto found = shelves_.find(digest);
  return found == shelves_.end() ? nullptr : found->second.library;
}

std::optional<Scenario> GainLibrary::FindDefinition(const std::string& digest) const {
  const std::shared_lock lock(mutex_);
  const auto found = shelves_.find(digest);
  return found == shelves_.end() ? std::nullopt : std::optional(found->second.definition);
}

std::vector<Scenario> GainLibrary::Definitions() const {
  const std::shared_lock lock(mutex_);
  std::vector<Scenario> definitions;
  for (const auto& [digest, shelf] : shelves_) {
    if (shelf.library->size() > 0) definitions.push_back(shelf.definition);
  }
  return definitions;
}

}  // namespace orbitune
