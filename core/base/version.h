// Which Orbitune this is: stored with results, so that one knows what made them.
#pragma once

#include <string_view>

namespace orbitune {

// "0.1.0".
std::string_view EngineVersion();

}  // namespace orbitune
