// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A window by SDL2: the module that display/window.hpp speaks of. All of it runs in one thread.

#define SDL_MAIN_HANDLED
#include <SDL.h>
#include <SDL_syswm.h>
#include <glob.h>

#include <cstring>
#include <string>

#include "display/window.hpp"
#include "window/x11.hpp"

namespace slicecorr::bridge::detail {
namespace {

std::string error(const char* what) { return std::string(what) + ": " + SDL_GetError(); }

std::string size_of(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

/// Whether there is a graphics processor; without one OpenGL is slower than copying.
bool has_gpu() {
  glob_t found{};
  const bool there = glob("/dev/dri/renderD*", GLOB_NOSORT, nullptr, &found) == 0 ||
                     glob("/dev/nvidiactl", GLOB_NOSORT, nullptr, &found) == 0;
  globfree(&found);
  return there;
}

/// Whether the renderer's OpenGL is a program, as that of Xvfb is wherever it runs.
bool is_software_gl() {
  using GetString = const unsigned char* (*)(unsigned);
  constexpr unsigned gl_renderer = 0x1F01;
  const auto get = reinterpret_cast<GetString>(SDL_GL_GetProcAddress("glGetString"));
  const auto* text = get ? reinterpret_cast<const char*>(get(gl_renderer)) : nullptr;
  return text && (std::strstr(text, "llvmpipe") || std::strstr(text, "softpipe") ||
                  std::strstr(text, "swrast"));
}

class SdlWindow final : public Window {
 public:
  ~SdlWindow() override {
    if (!guarded_) return;
    if (lost_) {
      // SDL would wait for ever for the window to go.
      x11_.restore();
      return;
    }
    if (texture_) SDL_DestroyTexture(texture_);
    if (renderer_) SDL_DestroyRenderer(renderer_);
    x11_.restore();
    if (window_) SDL_DestroyWindow(window_);
    if (begun_) SDL_QuitSubSystem(SDL_INIT_VIDEO);
    X11::unguard();
  }

  /// False: `found` says why.
  bool open(const WindowWanted& wanted, WindowFound& found) {
    width_px_ = wanted.width_px;
    height_px_ = wanted.height_px;
    found.wrong = X11::guard(wanted.died);
    if (!found.wrong.empty()) return false;
    guarded_ = true;
    SDL_SetMainReady();
    SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
    SDL_SetHint(SDL_HINT_VIDEO_ALLOW_SCREENSAVER, "0");
    SDL_SetHint(SDL_HINT_VIDEO_MINIMIZE_ON_FOCUS_LOSS, "0");
    SDL_SetHint(SDL_HINT_RENDER_SCALE_QUALITY, "nearest");
    // Else the "software" renderer goes through OpenGL after all.
    SDL_SetHint(SDL_HINT_FRAMEBUFFER_ACCELERATION, "0");
    if (SDL_InitSubSystem(SDL_INIT_VIDEO) != 0) {
      found.wrong = error("there is no display server");
      return false;
    }
    begun_ = true;
    // What SDL falls back to shows images to nobody.
    const std::string driver = SDL_GetCurrentVideoDriver();
    const char* asked = SDL_GetHint(SDL_HINT_VIDEODRIVER);
    if (driver != "x11" && driver != "wayland" && !(asked && *asked)) {
      found.wrong =
          "there is no display server; expected $DISPLAY or $WAYLAND_DISPLAY to name one (--sink "
          "drm needs none)";
      return false;
    }
    return choose(wanted, found) && make_window(found) && make_renderer(found) && settle(found);
  }

  std::string begin(Pixels& pixels) override {
    void* memory = nullptr;
    int pitch = 0;
    if (SDL_LockTexture(texture_, nullptr, &memory, &pitch) != 0) return error("lock");
    pixels = {static_cast<std::uint32_t*>(memory), static_cast<std::size_t>(pitch) / 4};
    return "";
  }

  std::string finish() override {
    SDL_UnlockTexture(texture_);
    return "";
  }

  std::string present() override {
    if (SDL_RenderCopy(renderer_, texture_, nullptr, nullptr) != 0) return error("copy");
    SDL_RenderPresent(renderer_);
    // What was sent is not what was done.
    if (gl_finish_) gl_finish_();
    return x11_.sync();
  }

  std::string check() override {
    std::string wrong;
    SDL_Event event;
    while (SDL_PollEvent(&event)) {
      const std::string news = judge(event);
      if (wrong.empty()) wrong = news;
    }
    return wrong.empty() ? x11_.error() : wrong;
  }

 private:
  bool choose(const WindowWanted& wanted, WindowFound& found) {
    const int count = SDL_GetNumVideoDisplays();
    std::string names;
    for (int i = 0; i < count; ++i) {
      const char* name = SDL_GetDisplayName(i);
      names += std::string(i ? ", " : "") + std::to_string(i) + " '" + (name ? name : "") + "'";
    }
    SDL_Rect place{};
    for (int i = 0; i < count && display_ < 0; ++i) {
      const char* name = SDL_GetDisplayName(i);
      if (wanted.display.empty() || wanted.display == std::to_string(i) ||
          (name && wanted.display == name) ||
          (SDL_GetDisplayBounds(i, &place) == 0 &&
           X11::has_output_at(wanted.display, place.x, place.y))) {
        display_ = i;
      }
    }
    found.input = true;
    if (display_ < 0) {
      found.wrong = "there is no display '" + wanted.display + "'; there are " + names;
      return false;
    }
    SDL_DisplayMode mode{};
    if (SDL_GetDesktopDisplayMode(display_, &mode) != 0 ||
        SDL_GetDisplayBounds(display_, &bounds_) != 0) {
      found.wrong = error("its mode can't be read");
      return false;
    }
    const char* name = SDL_GetDisplayName(display_);
    name_ = name ? name : "";
    if (mode.w != width_px_ || mode.h != height_px_) {
      found.wrong = "display '" + name_ + "' shows " + size_of(mode.w, mode.h) +
                    " pixels; expected exactly " + size_of(width_px_, height_px_) +
                    ", those of the printer";
      return false;
    }
    const int bits = SDL_BITSPERPIXEL(mode.format);
    if (bits < 24) {
      found.wrong = "display '" + name_ + "' has " + std::to_string(bits) +
                    " bits to a pixel; expected 24 at least";
      return false;
    }
    found.input = false;
    refresh_hz_ = mode.refresh_rate;
    return true;
  }

  bool make_window(WindowFound& found) {
    window_ = SDL_CreateWindow("slicecorr printbridge", bounds_.x, bounds_.y, width_px_, height_px_,
                               SDL_WINDOW_BORDERLESS | SDL_WINDOW_FULLSCREEN_DESKTOP |
                                   SDL_WINDOW_ALWAYS_ON_TOP | SDL_WINDOW_ALLOW_HIGHDPI |
                                   SDL_WINDOW_HIDDEN);
    if (!window_) found.wrong = error("no window");
    return window_ != nullptr;
  }

  bool make_renderer(WindowFound& found) {
    const char* asked = SDL_GetHint(SDL_HINT_RENDER_DRIVER);
    if (asked && *asked) {
      renderer_ = SDL_CreateRenderer(window_, -1, SDL_RENDERER_PRESENTVSYNC);
    } else if (has_gpu()) {
      renderer_ =
          SDL_CreateRenderer(window_, -1, SDL_RENDERER_ACCELERATED | SDL_RENDERER_PRESENTVSYNC);
      if (renderer_ && is_software_gl()) {
        SDL_DestroyRenderer(renderer_);
        renderer_ = nullptr;
      }
    }
    if (!renderer_) renderer_ = SDL_CreateRenderer(window_, -1, SDL_RENDERER_SOFTWARE);
    SDL_RendererInfo info{};
    if (!renderer_ || SDL_GetRendererInfo(renderer_, &info) != 0) {
      found.wrong = error("no renderer");
      return false;
    }
    // Not before: with the renderer SDL may have made the window anew.
    x11_.take(window_);
    if (std::strncmp(info.name, "opengl", 6) == 0) {
      gl_finish_ = reinterpret_cast<void (*)()>(SDL_GL_GetProcAddress("glFinish"));
    }
    texture_ = SDL_CreateTexture(renderer_, SDL_PIXELFORMAT_ARGB8888, SDL_TEXTUREACCESS_STREAMING,
                                 width_px_, height_px_);
    if (!texture_) {
      found.wrong = error("no texture");
      return false;
    }
    SDL_SetTextureBlendMode(texture_, SDL_BLENDMODE_NONE);
    SDL_SetTextureScaleMode(texture_, SDL_ScaleModeNearest);
    found.words = std::string("window on display '") + name_ + "' (" + SDL_GetCurrentVideoDriver() +
                  ", " + info.name + (info.flags & SDL_RENDERER_PRESENTVSYNC ? ", vsync" : "") +
                  (refresh_hz_ > 0 ? ", " + std::to_string(refresh_hz_) + " Hz" : "") + ")";
    return true;
  }

  /// Black, and waits until the window is where it belongs.
  bool settle(WindowFound& found) {
    SDL_DisableScreenSaver();
    x11_.keep_awake();
    SDL_ShowCursor(SDL_DISABLE);
    SDL_EventState(SDL_SYSWMEVENT, SDL_ENABLE);
    // Before it is shown: it tells when it is.
    x11_.follow_window();
    SDL_ShowWindow(window_);
    // Three: no buffer behind the window has anything else.
    for (int i = 0; i < 3; ++i) {
      SDL_SetRenderDrawColor(renderer_, 0, 0, 0, SDL_ALPHA_OPAQUE);
      SDL_RenderClear(renderer_);
      SDL_RenderPresent(renderer_);
    }
    const auto until = SDL_GetTicks64() + 2000;
    while (!x11_.unobscured() && SDL_GetTicks64() < until) {
      SDL_Event event;
      while (SDL_WaitEventTimeout(&event, 10)) judge(event);
    }
    int width = 0, height = 0, wide = 0, high = 0;
    SDL_GetRendererOutputSize(renderer_, &width, &height);
    SDL_GetWindowSize(window_, &wide, &high);
    if (width != width_px_ || height != height_px_ || wide != width_px_ || high != height_px_) {
      found.input = true;
      found.wrong = "display '" + name_ + "' is scaled: a window of " + size_of(wide, high) +
                    " is drawn with " + size_of(width, height) + " pixels; expected both to be " +
                    size_of(width_px_, height_px_);
      return false;
    }
    // Where the window manager put it.
    int x = 0, y = 0;
    SDL_GetWindowPosition(window_, &x, &y);
    if (x != bounds_.x || y != bounds_.y) {
      found.wrong = "the window manager puts the window to " + std::to_string(x) + ", " +
                    std::to_string(y) + "; expected it to cover the display at " +
                    std::to_string(bounds_.x) + ", " + std::to_string(bounds_.y);
      return false;
    }
    found.wrong = x11_.error();
    return found.wrong.empty();
  }

  /// What an event says against the window; empty: nothing.
  std::string judge(const SDL_Event& event) {
    if (event.type == SDL_SYSWMEVENT) return x11_.judge(event.syswm.msg);
    lost_ = lost_ ||
            (event.type == SDL_WINDOWEVENT && (event.window.event == SDL_WINDOWEVENT_HIDDEN ||
                                               event.window.event == SDL_WINDOWEVENT_MINIMIZED));
    if (event.type == SDL_QUIT) return "the window was closed, or its display server is gone";
    if (event.type == SDL_RENDER_DEVICE_RESET) return "the graphics processor was reset";
    if (event.type == SDL_DISPLAYEVENT && event.display.event == SDL_DISPLAYEVENT_DISCONNECTED &&
        static_cast<int>(event.display.display) == display_) {
      return "the display is disconnected";
    }
    if (event.type != SDL_WINDOWEVENT) return "";
    switch (event.window.event) {
      case SDL_WINDOWEVENT_CLOSE:
        return "the window was closed";
      case SDL_WINDOWEVENT_MINIMIZED:
        return "the window was minimised";
      case SDL_WINDOWEVENT_HIDDEN:
        return "the window was hidden";
      case SDL_WINDOWEVENT_MOVED:
        if (event.window.data1 == bounds_.x && event.window.data2 == bounds_.y) return "";
        return "the window was moved to " + std::to_string(event.window.data1) + ", " +
               std::to_string(event.window.data2);
      case SDL_WINDOWEVENT_SIZE_CHANGED:
        if (event.window.data1 == width_px_ && event.window.data2 == height_px_) return "";
        return "the window was given " + size_of(event.window.data1, event.window.data2) +
               " pixels; expected " + size_of(width_px_, height_px_);
      case SDL_WINDOWEVENT_FOCUS_LOST:
        // On the only display something is in front of it then. Beside others people work.
        if (x11_.knows_what_covers() || SDL_GetNumVideoDisplays() > 1) return "";
        return "another window has come to the front";
      default:
        return "";
    }
  }

  int width_px_ = 0, height_px_ = 0, display_ = -1, refresh_hz_ = 0;
  bool guarded_ = false, begun_ = false;
  bool lost_ = false;  ///< others have hidden or destroyed the window
  std::string name_;
  SDL_Rect bounds_{};
  SDL_Window* window_ = nullptr;
  SDL_Renderer* renderer_ = nullptr;
  SDL_Texture* texture_ = nullptr;
  void (*gl_finish_)() = nullptr;
  X11 x11_;
};

std::unique_ptr<Window> open_window(const WindowWanted& wanted, WindowFound& found) {
  auto window = std::make_unique<SdlWindow>();
  if (!window->open(wanted, found)) return nullptr;
  return window;
}

}  // namespace
}  // namespace slicecorr::bridge::detail

extern "C" __attribute__((visibility("default"))) slicecorr::bridge::detail::Window*
slicecorr_open_window(const slicecorr::bridge::detail::WindowWanted& wanted,
                      slicecorr::bridge::detail::WindowFound& found) {
  return slicecorr::bridge::detail::open_window(wanted, found).release();
}
