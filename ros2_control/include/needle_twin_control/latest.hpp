// The newest prediction and judgement of a twin, from a thread that hears them to a control loop that must not wait.
//
// Plain C++17 without ROS: tests/ros/ros2_control.rs compiles and runs it.
#ifndef NEEDLE_TWIN_CONTROL__LATEST_HPP_
#define NEEDLE_TWIN_CONTROL__LATEST_HPP_

#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

namespace needle_twin_control
{

/// A value from one thread that writes to one that reads. Neither locks nor allocates, and the reader never waits: it gives up
/// when a writer was in its way several times.
template <typename T>
class Slot
{
  static_assert(std::is_trivially_copyable_v<T>);
  static constexpr std::size_t kWords = (sizeof(T) + 7) / 8;
  static constexpr int kTries = 4;

public:
  void write(const T & value) noexcept
  {
    std::array<std::uint64_t, kWords> words{};
    std::memcpy(words.data(), &value, sizeof(T));
    const auto turn = turn_.load(std::memory_order_relaxed);
    turn_.store(turn + 1, std::memory_order_relaxed);  // odd: being written
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t i = 0; i < kWords; ++i) {
      words_[i].store(words[i], std::memory_order_relaxed);
    }
    turn_.store(turn + 2, std::memory_order_release);
  }

  /// Whether `value` is now the newest. If not, it is as it was.
  bool read(T & value) const noexcept
  {
    std::array<std::uint64_t, kWords> words{};
    for (int attempt = 0; attempt < kTries; ++attempt) {
      const auto before = turn_.load(std::memory_order_acquire);
      for (std::size_t i = 0; i < kWords; ++i) {
        words[i] = words_[i].load(std::memory_order_relaxed);
      }
      std::atomic_thread_fence(std::memory_order_acquire);
      if (before % 2 == 0 && turn_.load(std::memory_order_relaxed) == before) {
        std::memcpy(&value, words.data(), sizeof(T));
        return true;
      }
    }
    return false;
  }

private:
  std::atomic<std::uint64_t> turn_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

/// When something came, by a clock that never jumps, and its stamp; ns. Zeros: it never came.
struct When
{
  std::int64_t arrived_ns;
  std::int64_t stamp_ns;
};

/// Force, N, and torque, N m.
using Wrench = std::array<double, 6>;

struct Prediction
{
  When when;
  Wrench wrench;
};

struct Judgement
{
  When when;
  bool safe;
};

/// What the control loop sees.
struct State
{
  Wrench wrench;
  /// 1 or 0.
  double safe;
};

class Latest
{
public:
  explicit Latest(std::int64_t timeout_ns) noexcept : timeout_ns_(timeout_ns) {}

  void predicted(const Prediction & prediction) noexcept { prediction_.write(prediction); }
  void judged(const Judgement & judgement) noexcept { judgement_.write(judgement); }
  /// More than one publisher speaks: nobody can tell which twin is the one.
  void contested(bool is) noexcept { contested_.store(is, std::memory_order_relaxed); }

  /// The state at this time, by the clock of arrivals and by that of stamps. For one thread. What is stale or not finite is no
  /// number, and then nothing is safe.
  State read(std::int64_t arrivals_ns, std::int64_t stamps_ns) noexcept
  {
    prediction_.read(seen_prediction_);
    judgement_.read(seen_judgement_);
    const auto fresh = [&](const When & when) {
      return when.arrived_ns != 0 && within(arrivals_ns, when.arrived_ns) && within(stamps_ns, when.stamp_ns);
    };
    bool known = fresh(seen_prediction_.when) && !contested_.load(std::memory_order_relaxed);
    for (const double component : seen_prediction_.wrench) {
      known = known && std::isfinite(component);
    }
    State state{};
    state.wrench.fill(std::numeric_limits<double>::quiet_NaN());
    if (known) {
      state.wrench = seen_prediction_.wrench;
    }
    state.safe = known && fresh(seen_judgement_.when) && seen_judgement_.safe ? 1.0 : 0.0;
    return state;
  }

private:
  /// Neither older than the time-out nor that far in the future. Differences of unsigned numbers do not overflow.
  bool within(std::int64_t now, std::int64_t then) const noexcept
  {
    const auto difference = now > then
      ? static_cast<std::uint64_t>(now) - static_cast<std::uint64_t>(then)
      : static_cast<std::uint64_t>(then) - static_cast<std::uint64_t>(now);
    return difference <= static_cast<std::uint64_t>(timeout_ns_);
  }

  const std::int64_t timeout_ns_;
  Slot<Prediction> prediction_;
  Slot<Judgement> judgement_;
  std::atomic<bool> contested_{false};
  Prediction seen_prediction_{};
  Judgement seen_judgement_{};
};

}  // namespace needle_twin_control

#endif  // NEEDLE_TWIN_CONTROL__LATEST_HPP_
