// What a control loop sees of a twin: tests/ros/ros2_control.rs compiles and runs this.
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <thread>

#include "needle_twin_control/latest.hpp"

using namespace needle_twin_control;

#define CHECK(condition) \
  do { \
    if (!(condition)) { \
      std::printf("%d: %s\n", __LINE__, #condition); \
      std::exit(1); \
    } \
  } while (false)

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kBoot = 5'000 * kMs, kDate = 1'700'000'000'000 * kMs;

static bool silent(const State & state)
{
  bool nan = true;
  for (const double component : state.wrench) {
    nan = nan && std::isnan(component);
  }
  return nan && state.safe == 0.0;
}

static Prediction prediction(std::int64_t at, Wrench wrench) { return {{kBoot + at, kDate + at}, wrench}; }
static Judgement judgement(std::int64_t at, bool safe) { return {{kBoot + at, kDate + at}, safe}; }

static void what_is_fresh_is_shown_and_what_is_not_is_no_number()
{
  Latest latest(25 * kMs);
  const auto at = [&](std::int64_t arrivals, std::int64_t stamps) { return latest.read(kBoot + arrivals, kDate + stamps); };
  CHECK(silent(at(0, 0)));
  const Wrench wrench{0.1, -0.2, 3.0, 1e-3, 2e-3, -3e-3};
  latest.judged(judgement(0, true));
  CHECK(silent(at(1 * kMs, 1 * kMs)));  // safe without a force is none
  latest.predicted(prediction(0, wrench));
  const auto shown = at(1 * kMs, 1 * kMs);
  CHECK(shown.wrench == wrench && shown.safe == 1.0);
  latest.judged(judgement(1 * kMs, false));
  CHECK(at(2 * kMs, 2 * kMs).wrench == wrench && at(2 * kMs, 2 * kMs).safe == 0.0);
  // the judgement is old, the force is not
  latest.judged(judgement(0, true));
  latest.predicted(prediction(20 * kMs, wrench));
  CHECK(at(30 * kMs, 30 * kMs).wrench == wrench && at(30 * kMs, 30 * kMs).safe == 0.0);
  // the force is old, the judgement is not
  latest.judged(judgement(50 * kMs, true));
  CHECK(silent(at(50 * kMs, 50 * kMs)));
  latest.predicted(prediction(50 * kMs, wrench));
  CHECK(at(75 * kMs, 75 * kMs).safe == 1.0);
  CHECK(silent(at(76 * kMs, 50 * kMs)));  // came too long ago
  CHECK(silent(at(50 * kMs, 76 * kMs)));  // was stamped too long ago
  CHECK(silent(at(50 * kMs, 24 * kMs)));  // is stamped in the future
  // nobody set a stamp
  latest.predicted({{kBoot, 0}, wrench});
  CHECK(silent(at(0, 0)));
  latest.predicted({{kBoot, std::numeric_limits<std::int64_t>::min()}, wrench});
  CHECK(silent(at(0, 0)));
}

static void one_component_that_is_no_number_silences_all()
{
  for (std::size_t i = 0; i < 6; ++i) {
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      Latest latest(25 * kMs);
      Wrench wrench{};
      wrench[i] = bad;
      latest.judged(judgement(0, true));
      latest.predicted(prediction(0, wrench));
      CHECK(silent(latest.read(kBoot, kDate)));
    }
  }
}

static void two_publishers_are_none()
{
  Latest latest(25 * kMs);
  latest.judged(judgement(0, true));
  latest.predicted(prediction(0, Wrench{}));
  latest.contested(true);
  CHECK(silent(latest.read(kBoot, kDate)));
  latest.contested(false);
  CHECK(latest.read(kBoot, kDate).safe == 1.0);
}

// A wrench whose components are equal is never read half old and half new, and a reader always returns.
static void nothing_is_torn()
{
  Latest latest(std::numeric_limits<std::int64_t>::max());
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (int i = 1; !done.load(); ++i) {
      Wrench wrench{};
      wrench.fill(i);
      latest.predicted(prediction(i, wrench));
      latest.judged(judgement(i, i % 2 == 0));
    }
  });
  int changes = 0;
  double before = 0.0;
  for (int i = 0; i < 20'000'000 && changes < 20'000; ++i) {
    const auto state = latest.read(kBoot, kDate);
    if (std::isnan(state.wrench[0])) {
      continue;
    }
    for (const double component : state.wrench) {
      CHECK(component == state.wrench[0]);
    }
    CHECK(state.wrench[0] >= before);
    changes += state.wrench[0] > before ? 1 : 0;
    before = state.wrench[0];
  }
  done.store(true);
  writer.join();
  CHECK(changes > 10);
}

int main()
{
  what_is_fresh_is_shown_and_what_is_not_is_no_number();
  one_component_that_is_no_number_silences_all();
  two_publishers_are_none();
  nothing_is_torn();
  std::puts("sound");
}
