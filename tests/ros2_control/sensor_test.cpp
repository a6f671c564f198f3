// The plugin as a controller manager drives it: tests/ros/ros2_control.rs compiles and runs this with stubs/.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <thread>

#include "../../ros2_control/src/sensor.cpp"

#define CHECK(condition) \
  do { \
    if (!(condition)) { \
      std::printf("%d: %s\n", __LINE__, #condition); \
      std::exit(1); \
    } \
  } while (false)

using hardware_interface::CallbackReturn;
using hardware_interface::return_type;

static hardware_interface::HardwareComponentInterfaceParams asked(
  std::unordered_map<std::string, std::string> parameters, std::vector<hardware_interface::InterfaceInfo> interfaces)
{
  return {{"needle_twin", std::move(parameters), {{"twin", std::move(interfaces)}}}};
}

static const std::vector<hardware_interface::InterfaceInfo> kAll{
  {"force.x"}, {"force.y"}, {"force.z"}, {"torque.x"}, {"torque.y"}, {"torque.z"}, {"safe"}};

static builtin_interfaces::msg::Time stamp(std::int64_t age_ns)
{
  const auto ns = rclcpp::Clock().now().nanoseconds() - age_ns;
  return {static_cast<std::int32_t>(ns / 1000000000), static_cast<std::uint32_t>(ns % 1000000000)};
}

static void say(double z, bool safe, std::int64_t age_ns = 0)
{
  geometry_msgs::msg::WrenchStamped force{};
  force.header.stamp = stamp(age_ns);
  force.wrench = {{0.1, 0.2, z}, {0.4, 0.5, 0.6}};
  rclcpp::Network::publish("/or1/predicted_cf", force);
  needle_twin::msg::Safety safety{};
  safety.header.stamp = stamp(age_ns);
  safety.safe = safe;
  rclcpp::Network::publish("/or1/safety", safety);
}

int main()
{
  const rclcpp_lifecycle::State any;
  const auto refused = [&](const hardware_interface::HardwareComponentInterfaceParams & params) {
    return exported_by_pluginlib()->on_init(params) == CallbackReturn::ERROR;
  };
  CHECK(refused(asked({}, {{"force.w"}})));
  CHECK(refused({{"needle_twin", {}, {}}}));
  for (const auto * time : {"soon", "0", "-1", "nan", "1e9"}) {
    CHECK(refused(asked({{"timeout_s", time}}, kAll)));
  }

  const auto plugin = exported_by_pluginlib();
  // generous, since a test is held up longer than a control loop
  CHECK(plugin->on_init(asked({{"timeout_s", "0.5"}, {"namespace", "/or1/"}}, kAll)) == CallbackReturn::SUCCESS);
  const auto state = [&](const char * name) { return plugin->states.at(std::string("twin/") + name)->value; };
  const auto read = [&] { return plugin->read(rclcpp::Time(), rclcpp::Duration()); };
  const auto silent = [&] { return std::isnan(state("force.z")) && std::isnan(state("torque.x")) && state("safe") == 0.0; };
  CHECK(read() == return_type::OK);  // before it listens
  CHECK(plugin->on_configure(any) == CallbackReturn::SUCCESS);
  CHECK(read() == return_type::OK && silent());

  say(3.0, true);
  CHECK(read() == return_type::OK && state("force.x") == 0.1 && state("force.z") == 3.0 && state("torque.z") == 0.6);
  CHECK(state("safe") == 1.0);
  say(3.0, false);
  CHECK(read() == return_type::OK && state("force.z") == 3.0 && state("safe") == 0.0);
  say(std::numeric_limits<double>::infinity(), true);
  CHECK(read() == return_type::OK && silent());
  say(3.0, true, 1000000000);  // stamped a second ago
  CHECK(read() == return_type::OK && silent());
  say(3.0, true);
  CHECK(read() == return_type::OK && state("safe") == 1.0);
  std::this_thread::sleep_for(std::chrono::milliseconds(600));
  CHECK(read() == return_type::OK && silent());  // nothing came

  rclcpp::Network::publishers() = 2;
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  say(3.0, true);
  CHECK(read() == return_type::OK && silent());
  rclcpp::Network::publishers() = 1;
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  say(3.0, true);
  CHECK(read() == return_type::OK && state("safe") == 1.0);

  // an old yes that cannot be taken back ends the cycle with an error
  plugin->states.at("twin/safe")->held = true;
  say(3.0, false);
  CHECK(read() == return_type::ERROR);
  plugin->states.at("twin/safe")->held = false;

  // what is left behind is not a yes, and it can be configured again
  say(3.0, true);
  CHECK(read() == return_type::OK && state("safe") == 1.0);
  CHECK(plugin->on_error(any) == CallbackReturn::SUCCESS && silent());
  CHECK(plugin->on_configure(any) == CallbackReturn::SUCCESS);
  say(4.0, true);
  CHECK(read() == return_type::OK && state("force.z") == 4.0 && state("safe") == 1.0);
  CHECK(plugin->on_cleanup(any) == CallbackReturn::SUCCESS && silent());

  // a description may leave states out
  const auto some = exported_by_pluginlib();
  CHECK(some->on_init(asked({{"namespace", "/or1/"}}, {{"safe"}})) == CallbackReturn::SUCCESS);
  CHECK(some->on_configure(any) == CallbackReturn::SUCCESS && some->read(rclcpp::Time(), rclcpp::Duration()) == return_type::OK);
  std::puts("sound");
}
