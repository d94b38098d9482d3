// All that the server shows at /metrics; docs/operations.md says what each tells.
#pragma once

#include <string>

#include "server/api/api.h"
#include "server/jobs/scheduler.h"
#include "server/metrics/registry.h"
#include "storage/store_metrics.h"

namespace orbitune {

struct MetricsSources {
  const JobStore& store;
  const StoreMetrics& store_metrics;
  Scheduler& scheduler;
  Api& api;
  std::string database;  // path
  std::string version;
};

// All that `sources` refers to outlives the registry.
void AddServerMetrics(const MetricsSources& sources, MetricsRegistry& registry);

}  // namespace orbitune
