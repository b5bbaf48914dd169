#include "slicecorr/bridge/machine.hpp"
