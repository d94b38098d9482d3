// A campaign for people: how it stands, a line for each initial condition, and the tables at its end.
#pragma once

#include <optional>
#include <ostream>
#include <string>

#include "orbitune/v1/campaign.pb.h"

namespace orbitune::cli {

std::string CampaignStateText(v1::CampaignState state);  // "RUNNING"
std::string RoleText(v1::MemberRole role);               // "held out"
std::string ChoiceText(v1::GainsChoice choice);          // "K*, tuned for each"
std::string ChoiceKey(v1::GainsChoice choice);           // "tuned": in names of columns

// Whether the campaign changes no more by itself.
bool Ended(v1::CampaignState state);

// The episode under this choice of gains, if it is known.
const v1::MemberEpisode* FindEpisode(const v1::CampaignMember& member, v1::GainsChoice choice);

// "initial condition 7/50  SUCCEEDED  J 812.6 -> 141.6  82.6 % less  settles in 28.5 h  K* ...  jobs/abc".
std::string MemberLine(const v1::CampaignMember& member, const v1::CampaignProgress& progress);

// "12 of 50 initial conditions, 24000 iterations".
std::string ProgressText(const v1::CampaignProgress& progress);

// Gains, the paper's tables, percentiles, and what follows.
void PrintResults(const v1::CampaignResults& results, std::ostream& out);

// Everything a campaign is set to and where it stands; the results where there are some.
void PrintCampaign(const v1::Campaign& campaign, std::ostream& out);

// What a campaign that has ended came to.
void PrintCampaignSummary(const v1::Campaign& campaign, std::ostream& out);

}  // namespace orbitune::cli
