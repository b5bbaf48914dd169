// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The kernel's DRM/KMS, by way of libdrm. Never run on hardware by us: docs/bridge-displays.md.

#include "display/drm_calls.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge::detail {
namespace {

template <class T, void (*release)(T*)>
struct Release {
  void operator()(T* object) const { release(object); }
};
template <class T, void (*release)(T*)>
using Held = std::unique_ptr<T, Release<T, release>>;
using Resources = Held<drmModeRes, drmModeFreeResources>;
using ConnectorHandle = Held<drmModeConnector, drmModeFreeConnector>;
using EncoderHandle = Held<drmModeEncoder, drmModeFreeEncoder>;
using CrtcHandle = Held<drmModeCrtc, drmModeFreeCrtc>;
using PropertyList = Held<drmModeObjectProperties, drmModeFreeObjectProperties>;
using PropertyHandle = Held<drmModePropertyRes, drmModeFreeProperty>;

int code_of(int result) { return result == 0 ? 0 : result < -1 ? -result : errno; }

DrmMode mode_of(const drmModeModeInfo& info) {
  DrmMode mode;
  mode.width_px = info.hdisplay;
  mode.height_px = info.vdisplay;
  mode.interlaced = (info.flags & DRM_MODE_FLAG_INTERLACE) != 0;
  mode.doubled = (info.flags & DRM_MODE_FLAG_DBLSCAN) != 0 || info.vscan > 1;
  if (info.clock > 0) {
    mode.period_s = 1e-3 * info.htotal * info.vtotal / info.clock;
  }
  mode.raw = std::make_shared<drmModeModeInfo>(info);
  return mode;
}

std::string name_of(const drmModeConnector& c) {
  const char* type = drmModeGetConnectorTypeName(c.connector_type);
  return fmt::format("{}-{}", type ? type : "Unknown", c.connector_type_id);
}

/// An open card. A card has one master, so several displays of this process share its file.
struct Card {
  explicit Card(int opened) : file(opened) {}
  ~Card() { ::close(file); }
  Card(const Card&) = delete;
  Card& operator=(const Card&) = delete;
  const int file;
  std::mutex mutex;  ///< of what follows, and of reading events
  int masters = 0;
  /// Connectors by who drives them.
  std::map<std::uint32_t, const void*> taken;
};

class KernelDrm final : public DrmCalls {
 public:
  KernelDrm(std::string path, std::shared_ptr<Card> opened)
      : path_(std::move(path)), shared_(std::move(opened)), file_(shared_->file) {}
  ~KernelDrm() override {
    const std::scoped_lock lock(shared_->mutex);
    std::erase_if(shared_->taken, [this](const auto& t) { return t.second == this; });
  }

  std::string card() const override { return path_; }
  int become_master() override {
    const std::scoped_lock lock(shared_->mutex);
    const int code = drmIsMaster(file_) ? 0 : code_of(drmSetMaster(file_));
    if (code == 0) ++shared_->masters;
    return code;
  }
  void drop_master() override {
    const std::scoped_lock lock(shared_->mutex);
    if (--shared_->masters == 0) drmDropMaster(file_);
  }
  bool has_dumb_buffers() override { return capability(DRM_CAP_DUMB_BUFFER); }
  bool has_monotonic_times() override { return capability(DRM_CAP_TIMESTAMP_MONOTONIC); }

  std::vector<DrmConnector> connectors() override {
    std::vector<DrmConnector> all;
    const Resources resources(drmModeGetResources(file_));
    if (!resources) return all;
    for (int i = 0; i < resources->count_connectors; ++i) {
      const ConnectorHandle c(drmModeGetConnector(file_, resources->connectors[i]));
      if (!c || is_of_another(c->connector_id)) continue;
      DrmConnector connector;
      connector.id = c->connector_id;
      connector.name = name_of(*c);
      connector.connected = c->connection == DRM_MODE_CONNECTED;
      for (int m = 0; m < c->count_modes; ++m) connector.modes.push_back(mode_of(c->modes[m]));
      connector.crtcs = crtcs_of(*c, *resources);
      all.push_back(std::move(connector));
    }
    return all;
  }

  bool is_connected(std::uint32_t id) override {
    const ConnectorHandle c(drmModeGetConnectorCurrent(file_, id));
    return c && c->connection != DRM_MODE_DISCONNECTED;
  }

  int read_crtc(std::uint32_t id, DrmCrtcState& state) override {
    const CrtcHandle crtc(drmModeGetCrtc(file_, id));
    if (!crtc) return errno;
    state = {};
    state.on = crtc->mode_valid != 0;
    state.buffer = crtc->buffer_id;
    state.x = crtc->x;
    state.y = crtc->y;
    if (state.on) state.mode = mode_of(crtc->mode);
    const Resources resources(drmModeGetResources(file_));
    for (int i = 0; resources && i < resources->count_connectors; ++i) {
      const ConnectorHandle c(drmModeGetConnectorCurrent(file_, resources->connectors[i]));
      const EncoderHandle e(c && c->encoder_id ? drmModeGetEncoder(file_, c->encoder_id) : nullptr);
      if (e && e->crtc_id == id) state.connectors.push_back(c->connector_id);
    }
    return 0;
  }

  int set_crtc(std::uint32_t id, const DrmCrtcState& state) override {
    if (!state.on) return code_of(drmModeSetCrtc(file_, id, 0, 0, 0, nullptr, 0, nullptr));
    drmModeModeInfo mode = *static_cast<const drmModeModeInfo*>(state.mode.raw.get());
    std::vector<std::uint32_t> connectors = state.connectors;
    {
      const std::scoped_lock lock(shared_->mutex);
      for (const std::uint32_t connector : connectors) shared_->taken.emplace(connector, this);
    }
    return code_of(drmModeSetCrtc(file_, id, state.buffer, state.x, state.y, connectors.data(),
                                  static_cast<int>(connectors.size()), &mode));
  }

  int read_gamma(std::uint32_t id, DrmGamma& gamma) override {
    gamma = {};
    const CrtcHandle crtc(drmModeGetCrtc(file_, id));
    if (!crtc) return errno;
    if (crtc->gamma_size <= 0) return 0;
    const auto size = static_cast<std::size_t>(crtc->gamma_size);
    gamma.red.resize(size);
    gamma.green.resize(size);
    gamma.blue.resize(size);
    return code_of(drmModeCrtcGetGamma(file_, id, static_cast<std::uint32_t>(size),
                                       gamma.red.data(), gamma.green.data(), gamma.blue.data()));
  }
  int set_gamma(std::uint32_t id, const DrmGamma& gamma) override {
    // libdrm does not write to what it takes.
    const auto data = [](const std::vector<std::uint16_t>& table) {
      return const_cast<std::uint16_t*>(table.data());
    };
    return code_of(drmModeCrtcSetGamma(file_, id, static_cast<std::uint32_t>(gamma.red.size()),
                                       data(gamma.red), data(gamma.green), data(gamma.blue)));
  }

  std::vector<DrmProperty> properties(std::uint32_t connector) override {
    std::vector<DrmProperty> all;
    const PropertyList list(
        drmModeObjectGetProperties(file_, connector, DRM_MODE_OBJECT_CONNECTOR));
    for (std::uint32_t i = 0; list && i < list->count_props; ++i) {
      const PropertyHandle p(drmModeGetProperty(file_, list->props[i]));
      if (!p || (p->flags & DRM_MODE_PROP_IMMUTABLE) != 0) continue;
      DrmProperty property{p->prop_id, p->name, list->prop_values[i], {}};
      for (int w = 0; w < p->count_enums; ++w) {
        property.words.push_back({p->enums[w].name, p->enums[w].value});
      }
      all.push_back(std::move(property));
    }
    return all;
  }
  int set_property(std::uint32_t connector, const DrmProperty& property) override {
    return code_of(drmModeObjectSetProperty(file_, connector, DRM_MODE_OBJECT_CONNECTOR,
                                            property.id, property.value));
  }

  int make_buffer(int width_px, int height_px, DrmBuffer& buffer) override {
    drm_mode_create_dumb create{};
    create.width = static_cast<std::uint32_t>(width_px);
    create.height = static_cast<std::uint32_t>(height_px);
    create.bpp = 32;
    if (drmIoctl(file_, DRM_IOCTL_MODE_CREATE_DUMB, &create) != 0) return errno;
    DrmBuffer made;
    made.handle = create.handle;
    made.bytes = create.size;
    made.pitch_px = create.pitch / 4;
    drm_mode_map_dumb map{};
    map.handle = create.handle;
    int code = code_of(drmModeAddFB(file_, create.width, create.height, 24, 32, create.pitch,
                                    create.handle, &made.id));
    if (code == 0) code = code_of(drmIoctl(file_, DRM_IOCTL_MODE_MAP_DUMB, &map));
    if (code == 0) {
      void* const pixels = ::mmap(nullptr, made.bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file_,
                                  static_cast<off_t>(map.offset));
      if (pixels == MAP_FAILED) {
        code = errno;
      } else {
        made.pixels = static_cast<std::uint32_t*>(pixels);
      }
    }
    if (code != 0) {
      free_buffer(made);
    } else {
      buffer = made;
    }
    return code;
  }
  void free_buffer(const DrmBuffer& buffer) override {
    if (buffer.pixels) ::munmap(buffer.pixels, buffer.bytes);
    if (buffer.id != 0) drmModeRmFB(file_, buffer.id);
    drm_mode_destroy_dumb destroy{buffer.handle};
    drmIoctl(file_, DRM_IOCTL_MODE_DESTROY_DUMB, &destroy);
  }

  int flip(std::uint32_t crtc, std::uint32_t buffer) override {
    return code_of(drmModePageFlip(file_, crtc, buffer, DRM_MODE_PAGE_FLIP_EVENT, this));
  }

  int wait_flip(double timeout_s, DrmFlip& flip) override {
    const double until_s = monotonic_s() + timeout_s;
    while (!take_flip(flip)) {
      const double left_s = until_s - monotonic_s();
      if (left_s < 0) return ETIMEDOUT;
      pollfd p{file_, POLLIN, 0};
      // Not for long: another display of the card may have read this one's event meanwhile.
      const int ready = ::poll(&p, 1, static_cast<int>(std::ceil(std::min(left_s, kLookS) * 1e3)));
      if (ready < 0 && errno != EINTR) return errno;
      if (ready <= 0) continue;
      if ((p.revents & POLLIN) == 0) return ENODEV;  // unplugged, or taken away
      const std::scoped_lock lock(shared_->mutex);
      if (::poll(&p, 1, 0) <= 0) continue;
      drmEventContext context{};
      context.version = 2;
      context.page_flip_handler = [](int, unsigned sequence, unsigned s, unsigned us, void* self) {
        static_cast<KernelDrm*>(self)->flips_.push_back({sequence, s + 1e-6 * us});
      };
      if (drmHandleEvent(file_, &context) != 0) return EIO;
    }
    return 0;
  }

  double monotonic_s() const override {
    timespec t{};
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
  }

 private:
  bool capability(std::uint64_t what) const {
    std::uint64_t value = 0;
    return drmGetCap(file_, what, &value) == 0 && value != 0;
  }

  std::vector<std::uint32_t> crtcs_of(const drmModeConnector& c, const drmModeRes& all) const {
    std::vector<std::uint32_t> crtcs;
    const auto add = [&](std::uint32_t id) {
      if (id != 0 && std::find(crtcs.begin(), crtcs.end(), id) == crtcs.end()) crtcs.push_back(id);
    };
    if (const EncoderHandle e(c.encoder_id ? drmModeGetEncoder(file_, c.encoder_id) : nullptr); e) {
      add(e->crtc_id);
    }
    for (int i = 0; i < c.count_encoders; ++i) {
      const EncoderHandle e(drmModeGetEncoder(file_, c.encoders[i]));
      for (int n = 0; e && n < all.count_crtcs && n < 32; ++n) {
        if ((e->possible_crtcs >> n & 1U) != 0) add(all.crtcs[n]);
      }
    }
    return crtcs;
  }

  bool is_of_another(std::uint32_t connector) const {
    const std::scoped_lock lock(shared_->mutex);
    const auto found = shared_->taken.find(connector);
    return found != shared_->taken.end() && found->second != this;
  }
  bool take_flip(DrmFlip& flip) {
    const std::scoped_lock lock(shared_->mutex);
    if (flips_.empty()) return false;
    flip = flips_.front();
    flips_.erase(flips_.begin());
    return true;
  }

  static constexpr double kLookS = 0.002;
  const std::string path_;
  const std::shared_ptr<Card> shared_;
  const int file_;
  std::vector<DrmFlip> flips_;  ///< under the card's mutex
};

std::vector<std::string> cards() {
  std::vector<std::string> found;
  if (DIR* const folder = ::opendir("/dev/dri")) {
    while (const dirent* entry = ::readdir(folder)) {
      const std::string name = entry->d_name;
      if (name.starts_with("card")) found.push_back("/dev/dri/" + name);
    }
    ::closedir(folder);
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::unique_ptr<DrmCalls> open_card(const std::string& path, int& code) {
  static std::mutex opening;
  static std::map<std::string, std::weak_ptr<Card>> open;
  const std::scoped_lock lock(opening);
  code = 0;
  std::shared_ptr<Card> card = open[path].lock();
  if (!card) {
    const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    code = errno;
    if (file < 0) return nullptr;
    code = 0;
    open[path] = card = std::make_shared<Card>(file);
  }
  return std::make_unique<KernelDrm>(path, card);
}

}  // namespace

std::unique_ptr<DrmCalls> open_drm(const std::string& card) {
  int code = 0;
  if (!card.empty()) {
    const bool number = card.find_first_not_of("0123456789") == std::string::npos;
    const std::string path = card.starts_with('/') ? card
                             : number              ? "/dev/dri/card" + card
                                                   : "/dev/dri/" + card;
    auto calls = open_card(path, code);
    if (calls) return calls;
    const auto all = cards();
    throw DeviceError(fmt::format("{}: {}; expected one of {}", path, std::strerror(code),
                                  all.empty() ? "none, there is no /dev/dri/card*"
                                              : fmt::format("{}", fmt::join(all, ", "))));
  }
  std::string tried;
  for (const std::string& path : cards()) {
    auto calls = open_card(path, code);
    if (calls) {
      const auto connectors = calls->connectors();
      if (std::any_of(connectors.begin(), connectors.end(),
                      [](const DrmConnector& c) { return c.connected; })) {
        return calls;
      }
    }
    tried += fmt::format("{}{}: {}", tried.empty() ? "" : ", ", path,
                         calls ? "no display is connected" : std::strerror(code));
  }
  throw DeviceError("no display by DRM: " + (tried.empty() ? "there is no /dev/dri/card*" : tried));
}

}  // namespace slicecorr::bridge::detail
