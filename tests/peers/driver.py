"""A needle driver as a lab has it: a loop at 500 Hz that knows nothing of the twin but its topics, on Eclipse CycloneDDS.

It publishes measured_js and measured_cf, follows servo_jp with limited speed, and moves only while the newest `safety` says so and is
no older than 25 ms, by its stamp and by its arrival. One line of JSON on stdin, {"fault": NAME}, begins a fault of its load cell or
sensor; lines on stdout say when it moves and stands.
"""

import json
import math
import os
import random
import select
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

import ros_types

PERIOD_S = 0.002
SPEED_M_PER_S = 0.003
TIMEOUT_S = 0.025
SERVO_TIMEOUT_S = 0.03
STANDS_S = 0.02
NOISE_N = 2e-4


class Driver:
    def __init__(self, curve):
        self.curve = curve
        participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        joint, wrench = ros_types.message("sensor_msgs/msg/JointState"), ros_types.message("geometry_msgs/msg/WrenchStamped")
        safety = ros_types.message("needle_twin/msg/Safety")
        best = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(10))
        self.types = joint, wrench
        self.js = DataWriter(participant, Topic(participant, "rt/measured_js", joint), best)
        self.cf = DataWriter(participant, Topic(participant, "rt/measured_cf", wrench), best)
        self.servo = DataReader(participant, Topic(participant, "rt/servo_jp", joint), best)
        self.safety = DataReader(participant, Topic(participant, "rt/safety", safety), best)
        self.depth, self.goal, self.commanded, self.word, self.came = 0.0, 0.0, 0.0, None, 0.0
        self.fault, self.frozen = None, None

    def force(self):
        """Of the tissue on the needle, N."""
        for (a, f), (b, g) in zip(self.curve, self.curve[1:]):
            if self.depth <= b:
                return f + (g - f) * max(0.0, self.depth - a) / (b - a)
        return self.curve[-1][1]

    def listen(self):
        now = time.monotonic()
        for sample in self.servo.take(100):
            if getattr(sample, "position", None):
                self.goal, self.commanded = sample.position[0], now
        for sample in self.safety.take(100):
            if hasattr(sample, "safe"):
                self.word, self.came = sample, now

    def may_move(self):
        now = time.monotonic()
        if now - self.commanded > SERVO_TIMEOUT_S:
            return "servo_jp has ceased"
        if self.word is None or now - self.came > TIMEOUT_S:
            return "safety is silent"
        stamp = self.word.header.stamp
        if abs(time.time() - stamp.sec - 1e-9 * stamp.nanosec) > TIMEOUT_S:
            return "safety is old"
        return None if self.word.safe else "; ".join(self.word.reasons)

    def speak(self):
        nanos = time.time_ns()
        header = {"stamp": {"sec": nanos // 10**9, "nanosec": nanos % 10**9}, "frame_id": "sample"}
        joint, wrench = self.types
        if self.fault != "position silent":
            self.js.write(ros_types.from_dict(joint, {"header": header, "name": ["insertion"], "position": [self.depth]}))
        force = [0.0, 0.0, self.force() + random.gauss(0.0, NOISE_N)]
        if self.fault == "cell frozen":
            self.frozen = force = self.frozen or force
        if self.fault == "cell NaN":
            force = [math.nan] * 3
        if self.fault == "side load":
            force[0] += 50.0
        if self.fault != "cell silent":
            x, y, z = force
            self.cf.write(ros_types.from_dict(wrench, {"header": header, "wrench": {"force": {"x": x, "y": y, "z": z}}}))

    def run(self):
        due, said, moved, last = time.monotonic(), "", False, -1.0
        while True:
            due += PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))
            if time.monotonic() > due + 0.02:
                due = time.monotonic()
            if select.select([sys.stdin], [], [], 0)[0]:
                line = sys.stdin.readline()
                if not line:
                    return
                self.fault = json.loads(line)["fault"]
                self.tell(fault=self.fault)
            self.listen()
            why = self.may_move()
            before = self.depth
            if why is None:
                step = PERIOD_S * SPEED_M_PER_S
                self.depth += max(-step, min(step, self.goal - self.depth))
            self.speak()
            if self.depth != before:
                last = time.monotonic()
            moves = time.monotonic() - last < STANDS_S
            if moves != moved or (why or "")[:20] != said[:20]:
                self.tell(moves=moves, why=why or "", last_s=last)
            moved, said = moves, why or ""

    def tell(self, **what):
        print(json.dumps({"time_s": time.monotonic(), "depth_m": self.depth, **what}), flush=True)


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as table:
        rows = [line.split(",") for line in table if line[0].isdigit() or line[0] == "-"]
    Driver([(0.0, 0.0)] + [(float(row[0]), float(row[1])) for row in rows]).run()
