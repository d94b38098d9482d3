// A job's events in order, each once, over as many connections as it takes.
#pragma once

#include <cstdint>
#include <string>

#include "client/cli/interrupt.h"
#include "client/cli/reconnect.h"
#include "client/cli/session.h"
#include "client/cli/watch_sinks.h"
#include "grpcpp/support/status.h"
#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

class WatchStream {
 public:
  struct Options {
    std::string job;  // jobs/{id}
    std::int64_t resume_after_seq = 0;
    v1::Delivery delivery = v1::DELIVERY_EVERY;
    double reconnect_s = 60;  // how long to try, counted from the loss; 0: not at all
  };

  // All must outlive the stream.
  WatchStream(const Session& session, Options options, Interrupt& interrupt, WatchSink& sink);

  // Blocks until the job has ended (OK), the interrupt (CANCELLED), or an error that reconnecting does not mend.
  // A server that cannot be reached at the very first try is such an error.
  grpc::Status Run();

  // The job as the events so far leave it.
  const v1::Job& job() const { return job_; }

  // Of the last event seen; -1 if none was and only new ones were asked for.
  std::int64_t last_seq() const { return last_seq_; }

 private:
  grpc::Status ReadOnce();
  void OnMessage(const v1::WatchJobResponse& message);
  void OnEvent(const v1::WatchJobResponse& event);
  void OnSnapshot(const v1::WatchJobResponse& message);
  void NotePause();

  const Session& session_;
  const Options options_;
  Interrupt& interrupt_;
  WatchSink& sink_;
  v1::Job job_;
  std::int64_t last_seq_;
  std::int64_t snapshot_seq_ = -1;
  bool end_seen_ = false;  // the event that ends the job
  Reconnect reconnect_;
};

// Brings `job` up to date with an event that is no batch.
void ApplyEvent(const v1::WatchJobResponse& event, v1::Job* job);

}  // namespace orbitune::cli
