// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What is seen on an X11 display, by a client of its own; and what such a client can do to others.
/// Without Xlib's header, whose macros go together with nothing.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace slicecorr::test {

class Onlooker {
 public:
  using Id = unsigned long;
  /// On $DISPLAY. Throws `std::runtime_error`.
  Onlooker();
  ~Onlooker();

  /// All pixels of the screen, 0x00RRGGBB.
  std::vector<std::uint32_t> grab() const;
  void paint_root(std::uint32_t colour);
  /// The visible window that is as large as the screen; 0: there is none.
  Id image_window() const;

  /// A white window above all others.
  Id cover(int x, int y, int width, int height);
  void move(Id window, int x, int y);
  void resize(Id window, int width, int height);
  void unmap(Id window);
  void destroy(Id window);
  /// As the button of a window manager.
  void close(Id window);
  /// Closes the connection of the client that it belongs to.
  void kill_client(Id window);

  void put_pointer(int x, int y);
  /// Whether anything of the pointer can be seen.
  bool pointer_is_seen() const;
  /// Whether displays are switched off after a while; nothing: this server can't do that.
  std::optional<bool> saves_power() const;
  void save_power();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::test
