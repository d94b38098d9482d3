#include "server/metrics/registry.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <limits>

namespace orbitune {
namespace {

prometheus::ClientMetric WithLabels(const MetricLabels& labels) {
  prometheus::ClientMetric metric;
  for (const auto& [name, value] : labels) metric.label.push_back({name, value});
  return metric;
}

prometheus::ClientMetric::Histogram ToPrometheus(const Histogram::Snapshot& values) {
  prometheus::ClientMetric::Histogram histogram;
  for (std::size_t i = 0; i < values.counts.size(); ++i) {
    histogram.sample_count += values.counts[i];
    const bool last = i == values.bounds.size();
    histogram.bucket.push_back({.cumulative_count = histogram.sample_count,
                                .upper_bound = last ? std::numeric_limits<double>::infinity() : values.bounds[i]});
  }
  histogram.sample_sum = values.sum;
  return histogram;
}

auto One(std::function<double()> read) {
  return [read = std::move(read)] { return std::vector<MetricValue>{{.labels = {}, .value = read()}}; };
}

}  // namespace

void MetricsRegistry::AddGauge(std::string name, std::string help, Read<MetricValue> read) {
  families_.push_back({std::move(name), std::move(help), Type::kGauge, std::move(read), {}});
}

void MetricsRegistry::AddCounter(std::string name, std::string help, Read<MetricValue> read) {
  families_.push_back({std::move(name), std::move(help), Type::kCounter, std::move(read), {}});
}

void MetricsRegistry::AddHistogram(std::string name, std::string help, Read<MetricHistogram> read) {
  families_.push_back({std::move(name), std::move(help), Type::kHistogram, {}, std::move(read)});
}

void MetricsRegistry::AddGauge(std::string name, std::string help, std::function<double()> read) {
  AddGauge(std::move(name), std::move(help), Read<MetricValue>(One(std::move(read))));
}

void MetricsRegistry::AddCounter(std::string name, std::string help, std::function<double()> read) {
  AddCounter(std::move(name), std::move(help), Read<MetricValue>(One(std::move(read))));
}

void MetricsRegistry::AddHistogram(std::string name, std::string help, const Histogram& histogram) {
  AddHistogram(std::move(name), std::move(help),
               [&histogram] { return std::vector<MetricHistogram>{{.labels = {}, .values = histogram.Read()}}; });
}

std::string MetricsRegistry::Text() const {
  std::vector<prometheus::MetricFamily> families;
  for (const Family& family : families_) {
    prometheus::MetricFamily& out = families.emplace_back();
    out.name = family.name;
    out.help = family.help;
    if (family.type == Type::kHistogram) {
      out.type = prometheus::MetricType::Histogram;
      for (const MetricHistogram& row : family.histograms()) {
        out.metric.push_back(WithLabels(row.labels));
        out.metric.back().histogram = ToPrometheus(row.values);
      }
      continue;
    }
    out.type = family.type == Type::kGauge ? prometheus::MetricType::Gauge : prometheus::MetricType::Counter;
    for (const MetricValue& row : family.values()) {
      out.metric.push_back(WithLabels(row.labels));
      out.metric.back().gauge.value = out.metric.back().counter.value = row.value;
    }
  }
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace orbitune
