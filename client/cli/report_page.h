// A job or a campaign as one self-contained HTML page: figures as inline SVG, tables, provenance; no script and nothing
// from elsewhere. Well-formed as XML, too.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "client/cli/plot.h"
#include "orbitune/v1/campaign.pb.h"

namespace orbitune::cli {

// Some gains flown: the distance to the target in km, over the time in hours.
struct FlownGains {
  std::string style;  // of the line
  std::string title;
  std::vector<PlotPoint> distance;
};

struct JobPageData {
  v1::Job job;
  std::vector<v1::Iteration> iterations;
  std::vector<FlownGains> flown;  // at the first start, where there are several
};

// One member's lines; thinned is as good.
struct MemberLines {
  std::vector<PlotPoint> before;                // km over hours, under K(1)
  std::vector<PlotPoint> after;                 // under K*
  std::array<std::vector<PlotPoint>, 5> gains;  // over iterations
};

struct CampaignPageData {
  v1::Campaign campaign;
  std::vector<v1::CampaignMember> members;
  std::vector<MemberLines> lines;
  std::vector<FlownGains> flown;  // at one initial condition,
  int flown_at = 0;               // this tuned one
};

std::string JobPage(const JobPageData& data);
std::string CampaignPage(const CampaignPageData& data);

// About so many points a line may have, that the page stays under 2 MB: of the distances, and of the gains.
int DistancePointsPerLine(std::size_t members);
int GainPointsPerLine(std::size_t members);

}  // namespace orbitune::cli
