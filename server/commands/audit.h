// `orbituned audit`.
#pragma once

namespace orbitune {

int RunAudit(int argc, char** argv);

}  // namespace orbitune
