// A verification as a stream: progress now and then, what there is of it when it is asked for, and then the result.
#pragma once

#include "server/api/caller.h"
#include "server/api/job_feed.h"

namespace orbitune {

// Runs on threads of its own (Work::kVerify), below what tunes, from when the feed is first asked until it is over or
// the feed is ended.
std::shared_ptr<Feed> NewVerifyFeed(const v1::VerifyJobRequest& request, const Caller& caller,
                                    const JobFeedContext& context);

}  // namespace orbitune
