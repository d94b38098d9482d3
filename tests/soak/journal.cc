#include "tests/soak/journal.h"

#include <algorithm>
#include <cmath>

namespace orbitune::soak {
namespace {

constexpr double kFirst_s = 1e-6;
constexpr double kFactor = 1.02;

}  // namespace

void Latencies::Note(double seconds) {
  const double bucket = std::log(std::max(seconds, kFirst_s) / kFirst_s) / std::log(kFactor);
  ++buckets_[std::min(static_cast<std::size_t>(bucket), buckets_.size() - 1)];
}

std::int64_t Latencies::count() const {
  std::int64_t all = 0;
  for (const auto& bucket : buckets_) all += bucket;
  return all;
}

double Latencies::Percentile_ms(double p) const {
  const double wanted = p * static_cast<double>(count());
  double seen = 0;
  for (std::size_t i = 0; i < buckets_.size(); ++i) {
    seen += static_cast<double>(buckets_[i]);
    if (seen >= wanted && seen > 0) return 1e3 * kFirst_s * std::pow(kFactor, static_cast<double>(i) + 1);
  }
  return 0;
}

void Latencies::Clear() {
  for (auto& bucket : buckets_) bucket = 0;
}

double FirstSeen::Note(std::int64_t seq, Clock::time_point now) {
  Slot& slot = slots_[static_cast<std::size_t>(seq) % slots_.size()];
  const std::int64_t now_ns = std::chrono::nanoseconds(now.time_since_epoch()).count();
  std::int64_t there = slot.seq;
  if (there == seq) {
    const std::int64_t at_ns = slot.at_ns;
    return at_ns == 0 ? 0 : static_cast<double>(now_ns - at_ns) * 1e-9;
  }
  if (there > seq || !slot.seq.compare_exchange_strong(there, seq)) return 0;
  slot.at_ns = now_ns;
  return 0;
}

void Journal::Fault(const std::string& what) {
  ++fault_count;
  const std::lock_guard lock(mutex_);
  if (faults_.size() < 20) faults_.push_back(what);
}

std::vector<std::string> Journal::faults() {
  const std::lock_guard lock(mutex_);
  return faults_;
}

void SequenceCheck::Take(std::int64_t first, std::int64_t seq, Journal& journal) {
  if (first != last_ + 1 || seq < first) {
    journal.Fault(who_ + ": events " + std::to_string(first) + " to " + std::to_string(seq) + " after " +
                  std::to_string(last_));
  }
  last_ = seq;
}

}  // namespace orbitune::soak
