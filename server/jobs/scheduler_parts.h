// What the scheduler's own files share, and nobody else sees: unfinished jobs, their clients, and who is next.
// scheduler.cc has the life of the scheduler and the jobs' states, scheduler_queue.cc what waits, scheduler_workers.cc
// what runs. All of it is guarded by the scheduler's mutex.
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/check.h"
#include "server/jobs/job_run.h"
#include "server/jobs/scheduler.h"

namespace orbitune {

// An unfinished job.
struct Scheduler::Entry {
  Entry(JobRecord r, ClientPtr c) : record(std::move(r)), client(std::move(c)) {
    ORBITUNE_CHECK(record.provenance.has_value());
  }

  JobRecord record;  // as of the newest event queued at the store
  const ClientPtr client;
  std::shared_ptr<JobRun> run;
  std::int64_t pairs_left_out = 0;
  int uncommitted = 0;

  // While it waits.
  struct Place {
    int rank = 0;  // the highest priority has the least
    std::uint64_t order = 0;
    auto operator<=>(const Place&) const = default;
  };
  std::optional<Place> place;
  std::chrono::steady_clock::time_point queued_at;

  // In steps of the integrator, of a vector of episodes or of one: what the workers' time goes into, whatever the clock
  // says of it.
  double used = 0;         // over its weight
  double chunk_steps = 0;  // what a chunk of it took lately

  bool HasWork(const Options& options) const {
    return run != nullptr && run->has_unclaimed() && uncommitted < options.max_uncommitted_iterations;
  }
};

struct Scheduler::Client {
  // Of one campaign's jobs, or of those that are part of none: by place, and by age alone.
  struct Queue {
    std::map<Entry::Place, EntryPtr> by_place;
    std::map<std::uint64_t, EntryPtr> by_age;
  };

  std::vector<EntryPtr> running;
  std::map<std::string, Queue> waiting;    // by campaign; none is empty
  std::map<std::string, int> of_campaign;  // running jobs of each
  std::uint64_t begun = 0;                 // jobs so far
  std::uint64_t last_begun = 0;            // the number of the last one among all clients'
  int jobs = 0;                            // unfinished, and room for some
  int of_no_campaign = 0;                  // of them
  std::int64_t job_bytes = 0;              // of them
  double used = 0;                         // of the workers' time
  double served = 0;                       // what its job served last had had

  bool HasRoomFor(const std::string& campaign, int most_of_campaign) const;
  // The one to begin next; nullptr where none may.
  EntryPtr NextWaiting(int most_of_campaign) const;
  // The running job to be served next; nullptr where none has work.
  const EntryPtr* NextRunning(const Options& options) const;
};

// One unit of work.
struct Scheduler::Chunk {
  EntryPtr entry;
  std::shared_ptr<JobRun> run;
  JobRun::Share share;
  double charged = 0;  // for it, before it was flown
};

}  // namespace orbitune
