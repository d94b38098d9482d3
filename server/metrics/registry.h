// What the server tells Prometheus: families of values that are read when somebody asks for them.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/histogram.h"

namespace orbitune {

using MetricLabels = std::vector<std::pair<std::string, std::string>>;

struct MetricValue {
  MetricLabels labels;
  double value = 0;
};

struct MetricHistogram {
  MetricLabels labels;
  Histogram::Snapshot values;
};

// Filled once, then constant: thread-safe from then on, as far as what it reads is.
class MetricsRegistry {
 public:
  template <typename T>
  using Read = std::function<std::vector<T>()>;

  // name: by Prometheus's rules, a counter's ends in "_total". read: called by Text.
  void AddGauge(std::string name, std::string help, Read<MetricValue> read);
  void AddCounter(std::string name, std::string help, Read<MetricValue> read);
  void AddHistogram(std::string name, std::string help, Read<MetricHistogram> read);

  // Of one value, without labels.
  void AddGauge(std::string name, std::string help, std::function<double()> read);
  void AddCounter(std::string name, std::string help, std::function<double()> read);
  void AddHistogram(std::string name, std::string help, const Histogram& histogram);  // outlives the registry

  // All families in the text format 0.0.4.
  std::string Text() const;

 private:
  enum class Type { kGauge, kCounter, kHistogram };
  struct Family {
    std::string name;
    std::string help;
    Type type;
    Read<MetricValue> values;          // unless kHistogram
    Read<MetricHistogram> histograms;  // where kHistogram
  };
  std::vector<Family> families_;
};

}  // namespace orbitune
