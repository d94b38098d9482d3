// `orbituned token create|list|revoke`.
#pragma once

namespace orbitune {

int RunToken(int argc, char** argv);

}  // namespace orbitune
