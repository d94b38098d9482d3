// The machine's limit: how many double-precision fused multiply-adds a core can do in a second.
#pragma once

namespace orbitune::bench {

// Measured on the calling thread, with the instruction set that core/simd uses, over about 20 ms. Two operations each;
// without a fused instruction, a multiplication and an addition.
double PeakFmaPerSecond();

}  // namespace orbitune::bench
