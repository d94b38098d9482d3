#include "core/base/version.h"

namespace orbitune {

std::string_view EngineVersion() { return ORBITUNE_VERSION; }

}  // namespace orbitune
