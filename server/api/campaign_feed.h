// The events of one campaign: a snapshot, then every one after a seq, read from the store as they come, and between
// them how far the jobs have got.
#pragma once

#include "server/api/executor.h"
#include "server/api/feed.h"
#include "server/convert/campaign.h"

namespace orbitune {

// What feeds of campaigns share; all outlive them.
struct CampaignFeedContext {
  CampaignUseCases& use_cases;
  Executors& executors;  // for reading the store
  Feeds& feeds;
};

std::shared_ptr<Feed> NewCampaignFeed(const v1::WatchCampaignRequest& request, const CampaignFeedContext& context);

}  // namespace orbitune
