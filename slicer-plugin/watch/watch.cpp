#include "watch/watch.hpp"
namespace slicecorr::post {
WatchResult watch(const WatchOptions&, const Context&, Log&, const Job&) { return {}; }
}  // namespace slicecorr::post
