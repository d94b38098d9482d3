// A campaign's members as a CSV table: units in the headers, doubles that round-trip.
#pragma once

#include <string>
#include <vector>

#include "orbitune/v1/campaign.pb.h"

namespace orbitune::cli {

// The header, then a row for each; elements of the forms that occur, what is not known empty.
std::string CampaignCsv(const std::vector<v1::CampaignMember>& members);

// Whether the table has a column of this name, beside the elements.
bool IsCampaignCsvColumn(const std::string& name);

}  // namespace orbitune::cli
