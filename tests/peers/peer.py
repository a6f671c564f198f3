"""An independent DDS peer: Eclipse CycloneDDS, driven line by line with JSON on stdin, answering on stdout.

Each line is {"op": NAME, ...}; each answer is one line, {"error": TEXT} if it failed.
"""

import json
import math
import os
import sys
import time

from cyclonedds.builtin import (BuiltinDataReader, BuiltinTopicDcpsParticipant, BuiltinTopicDcpsPublication,
                                BuiltinTopicDcpsSubscription)
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

import ros_types

QOS = {
    "reliable": [Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.Volatile],
    "best_effort": [Policy.Reliability.BestEffort, Policy.Durability.Volatile],
    "latched": [Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal],
}


def qos(name, depth=2000):
    if name == "full":  # takes `depth` samples, then makes its writers wait
        return Qos(*QOS["reliable"], Policy.History.KeepAll, Policy.ResourceLimits(depth, 1, depth))
    return Qos(*QOS[name], Policy.History.KeepLast(depth))


def finite(value):
    """JSON has no NaN: such numbers become strings, which no test takes for a number."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return value


def stamp(nanos):
    return {"sec": nanos // 1_000_000_000, "nanosec": nanos % 1_000_000_000}


class Peer:
    def __init__(self):
        self.participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self.readers = {}
        self.writers = {}
        self.clients = {}
        self.received = {}

    def _topic(self, name, cls):
        return Topic(self.participant, f"rt{name}", cls)

    def subscribe(self, topic, type, qos="reliable", depth=2000):
        cls = ros_types.message(type)
        reader = DataReader(self.participant, self._topic(topic, cls), globals()["qos"](qos, depth))
        self.readers[topic] = reader
        self.received[topic] = []
        return {}

    def advertise(self, topic, type, qos="reliable", depth=2000):
        cls = ros_types.message(type)
        writer = DataWriter(self.participant, self._topic(topic, cls), globals()["qos"](qos, depth))
        self.writers[topic] = (writer, cls)
        return {}

    def wait_matched(self, topics, timeout=20.0):
        """Until every one of these topics has a peer on the other side."""
        end = time.monotonic() + timeout
        missing = list(topics)
        while missing and time.monotonic() < end:
            missing = [t for t in missing if not self._matched(t)]
            time.sleep(0.01)
        return {"missing": missing}

    def _matched(self, topic):
        if topic in self.writers:
            return len(self.writers[topic][0].get_matched_subscriptions()) > 0
        return len(self.readers[topic].get_matched_publications()) > 0

    def publish(self, topic, value):
        writer, cls = self.writers[topic]
        if "position" in value:  # a NaN can't be said in JSON
            value["position"] = [float(v) for v in value["position"]]
        writer.write(ros_types.from_dict(cls, value))
        return {}

    def steps(self, topic, joint, poses, answers, wrench_topic=None, wrenches=None, timeout=3.0, ahead=0):
        """Poses [nanos, depth_m] one after the other, each answered before the next. The force along z that answers
        each, None where none came in time; a wrench [x, y, z] (NaN as text) or null goes out before each pose, with a stamp
        that is `ahead` ns later."""
        writer, cls = self.writers[topic]
        forces = []
        for i, (nanos, depth) in enumerate(poses):
            if wrenches and wrenches[i]:
                x, y, z = map(float, wrenches[i])
                self.publish(wrench_topic, {"header": {"stamp": stamp(nanos + ahead), "frame_id": "sample"},
                                            "wrench": {"force": {"x": x, "y": y, "z": z}}})
            writer.write(ros_types.from_dict(
                cls, {"header": {"stamp": stamp(nanos), "frame_id": ""}, "name": [joint], "position": [float(depth)]}))
            answered, end = {}, time.monotonic() + timeout
            while nanos not in answered and time.monotonic() < end:
                self._note(answers, answered)
                time.sleep(0.0005)
            forces.append(answered[nanos][1][2] if nanos in answered else None)
        return {"forces": forces}

    def burst(self, topic, joint, poses, rate_hz, depth_m, first_nanos, step_nanos):
        """Poses as fast as asked for, made beforehand; how long it took and the last stamp."""
        writer, cls = self.writers[topic]
        last = first_nanos + (poses - 1) * step_nanos
        made = [ros_types.from_dict(cls, {"header": {"stamp": stamp(first_nanos + i * step_nanos), "frame_id": ""},
                                          "name": [joint], "position": [float(depth_m * i / poses)]})
                for i in range(poses)]
        begun = time.monotonic()
        for i, message in enumerate(made):
            while time.monotonic() < begun + i / rate_hz:
                pass
            writer.write(message)
        return {"seconds": time.monotonic() - begun, "last_nanos": last}

    def insert(self, topic, joint, poses, rate_hz, depth_m, from_m=0.0, force_topic=None, force_n=0.0, n_per_m=0.0,
               answers=None, first_nanos=None):
        """Streams poses of an insertion in real time and notes when each answer comes. Returns the round trips."""
        writer, cls = self.writers[topic]
        begun = time.monotonic()
        first = first_nanos if first_nanos is not None else time.time_ns()
        sent, answered = {}, {}
        for i in range(poses):
            due = begun + i / rate_hz
            while True:
                self._note(answers, answered)
                left = due - time.monotonic()
                if left <= 0:
                    break
                time.sleep(min(left, 0.0002))
            nanos = first + int(i * 1e9 / rate_hz)
            depth = from_m + (depth_m - from_m) * i / max(poses - 1, 1)
            header = {"stamp": stamp(nanos), "frame_id": ""}
            if force_topic:
                self.publish(force_topic, {"header": {"stamp": stamp(nanos), "frame_id": "sample"},
                                           "wrench": {"force": {"x": 0.0, "y": 0.0, "z": float(force_n + n_per_m * depth)}}})
            writer.write(ros_types.from_dict(cls, {"header": header, "name": [joint], "position": [float(depth)]}))
            sent[nanos] = time.monotonic()
        end = time.monotonic() + 1.0
        while time.monotonic() < end and len(answered) < len(sent):
            self._note(answers, answered)
            time.sleep(0.0005)
        trips = sorted(answered[n][0] - sent[n] for n in answered if n in sent)
        pick = lambda q: trips[min(int(q * len(trips)), len(trips) - 1)] if trips else None
        forces = [answered[n][1] for n in sorted(answered)]
        times = [begun] + sorted(answered[n][0] for n in answered if n in sent) + [max(sent.values(), default=begun)]
        gaps = [later - sooner for sooner, later in zip(times, times[1:])]
        return {
            "sent": len(sent),
            "answered": len(trips),
            "unasked": sum(n not in sent for n in answered),
            "median_s": pick(0.5), "p99_s": pick(0.99), "max_s": trips[-1] if trips else None,
            "first_s": gaps[0], "longest_gap_s": max(gaps),
            "forces": forces,
            "frames": sorted({answered[n][2] for n in answered}),
        }

    def ping(self, topic, joint, poses, rate_hz, depth_m, answers):
        """Sends a pose, waits for its answer without sleeping, sends the next when it is due. Returns the round trips."""
        writer, cls = self.writers[topic]
        begun, first, trips = time.monotonic(), time.time_ns(), []
        for i in range(poses):
            while time.monotonic() < begun + i / rate_hz:
                pass
            nanos = first + int(i * 1e9 / rate_hz)
            answered, asked = {}, time.monotonic()
            depth = depth_m * i / poses
            header = {"stamp": stamp(nanos), "frame_id": ""}
            writer.write(ros_types.from_dict(cls, {"header": header, "name": [joint], "position": [depth]}))
            while nanos not in answered and time.monotonic() < asked + 0.05:
                self._note(answers, answered)
            if nanos in answered:
                trips.append(answered[nanos][0] - asked)
        trips.sort()
        pick = lambda q: trips[min(int(q * len(trips)), len(trips) - 1)] if trips else None
        return {"sent": poses, "answered": len(trips), "median_s": pick(0.5), "p99_s": pick(0.99), "max_s": pick(1.0)}

    def _note(self, topic, answered):
        if topic is None:
            return
        for sample in self.readers[topic].take(N=100):
            header = getattr(sample, "header", None)
            if header is not None:
                nanos = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
                force = sample.wrench.force
                answered[nanos] = (time.monotonic(), [force.x, force.y, force.z], header.frame_id)

    def take(self, topic, timeout=5.0, count=1):
        """At least `count` messages (or what came until the time-out)."""
        end = time.monotonic() + timeout
        found = []
        while True:
            for sample in self.readers[topic].take(N=1000):
                if hasattr(sample, "__dataclass_fields__"):
                    found.append(ros_types.to_dict(sample))
            if len(found) >= count or time.monotonic() >= end:
                return {"messages": found}
            time.sleep(0.002)

    def sent_times(self, topic, count, timeout=10.0):
        """When each message was sent, ns, as the sender's DDS says it, with the message's own stamp."""
        end = time.monotonic() + timeout
        found = []
        while len(found) < count and time.monotonic() < end:
            for sample in self.readers[topic].take(N=1000):
                if hasattr(sample, "__dataclass_fields__"):
                    own = sample.header.stamp
                    found.append([sample.sample_info.source_timestamp, own.sec * 1_000_000_000 + own.nanosec])
            time.sleep(0.002)
        return {"times": found}

    def endpoints(self):
        """Every publisher and subscription of the domain: topic, type, reliability, durability."""
        found = []
        for topic, side in ((BuiltinTopicDcpsPublication, "publisher"), (BuiltinTopicDcpsSubscription, "subscription")):
            reader = BuiltinDataReader(self.participant, topic)
            end = time.monotonic() + 2.0
            seen = {}
            while time.monotonic() < end:
                for sample in reader.take(N=1000):
                    if sample.sample_info.valid_data:
                        seen[str(sample.key)] = sample
                time.sleep(0.05)
            for sample in seen.values():
                found.append({"side": side, "topic": sample.topic_name, "type": sample.type_name,
                              "reliable": isinstance(sample.qos[Policy.Reliability], Policy.Reliability.Reliable),
                              "latched": sample.qos[Policy.Durability] == Policy.Durability.TransientLocal})
        return {"endpoints": found}

    def participants(self, wanted, timeout=20.0):
        """How many others there are in the domain, once they are as many as wanted or time is up."""
        reader = BuiltinDataReader(self.participant, BuiltinTopicDcpsParticipant)
        end, alive = time.monotonic() + timeout, set()
        while time.monotonic() < end:
            for sample in reader.take(N=1000):
                gone = int(sample.sample_info.instance_state) != 16  # DDS_ALIVE_INSTANCE_STATE
                (alive.discard if gone else alive.add)(str(sample.key))
            if len(alive) - 1 == wanted:
                break
            time.sleep(0.05)
        return {"others": len(alive) - 1}

    def last(self, topic, seconds=1.0):
        """The newest message after listening for so long."""
        end = time.monotonic() + seconds
        newest, count = None, 0
        while time.monotonic() < end:
            for sample in self.readers[topic].take(N=1000):
                if hasattr(sample, "__dataclass_fields__"):
                    newest = sample
                    count += 1
            time.sleep(0.002)
        return {"count": count, "message": ros_types.to_dict(newest) if newest is not None else None}

    def call(self, service, type, request=None, timeout=30.0, quiet=False):
        """Calls a service as rmw_cyclonedds does; `quiet`: without an answer the response is null."""
        if service not in self.clients:
            ask, reply = ros_types.service(type)
            request_topic = Topic(self.participant, f"rq{service}Request", ask)
            reply_topic = Topic(self.participant, f"rr{service}Reply", reply)
            self.clients[service] = (
                DataWriter(self.participant, request_topic, qos("reliable", 10)),
                DataReader(self.participant, reply_topic, qos("reliable", 10)),
                ask,
                [0],
            )
        writer, reader, ask, counter = self.clients[service]
        end = time.monotonic() + timeout
        while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
            if time.monotonic() > end:
                return {"error": f"no server of {service}"}
            time.sleep(0.01)
        counter[0] += 1
        guid = writer.guid.bytes[8:16] if hasattr(writer.guid, "bytes") else bytes(range(8))
        values = {"client_guid": list(guid), "sequence_number": counter[0]} | (request or {})
        writer.write(ros_types.from_dict(ask, values))
        while time.monotonic() < end:
            for sample in reader.take(N=10):
                # Answers to other callers come too.
                if hasattr(sample, "sequence_number") and sample.sequence_number == counter[0] \
                        and list(sample.client_guid) == values["client_guid"]:
                    return {"response": ros_types.to_dict(sample)}
            time.sleep(0.002)
        return {"response": None} if quiet else {"error": f"no answer from {service}"}

    def call_early(self, service, type, reader_after_s, timeout=10.0):
        """Calls before there is a reader for the answer, which comes so many seconds later."""
        ask, reply = ros_types.service(type)
        writer = DataWriter(self.participant, Topic(self.participant, f"rq{service}Request", ask), qos("reliable", 10))
        end = time.monotonic() + timeout
        while not writer.get_matched_subscriptions() and time.monotonic() < end:
            time.sleep(0.01)
        writer.write(ros_types.from_dict(ask, {"client_guid": list(writer.guid.bytes[8:16]), "sequence_number": 77}))
        time.sleep(reader_after_s)
        reader = DataReader(self.participant, Topic(self.participant, f"rr{service}Reply", reply), qos("reliable", 10))
        while time.monotonic() < end:
            for sample in reader.take(N=10):
                if hasattr(sample, "sequence_number") and sample.sequence_number == 77:
                    return {"response": ros_types.to_dict(sample)}
            time.sleep(0.002)
        return {"error": f"no answer from {service}"}

    def garble(self, dds_topic, dds_type, bodies, times=1):
        """Publishes bodies (bytes as hex) that are no message of the type that they claim to be; how many had a reader."""
        heard = 0
        for body in map(bytes.fromhex, bodies):
            # A participant has one type per topic, so each body gets a participant of its own.
            participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
            cls = make_idl_struct("Garbled", dds_type, {"body": array[uint8, len(body)]})
            writer = DataWriter(participant, Topic(participant, dds_topic, cls), qos("reliable", 100))
            end = time.monotonic() + 20.0
            while not writer.get_matched_subscriptions() and time.monotonic() < end:
                time.sleep(0.01)
            heard += bool(writer.get_matched_subscriptions())
            # Known to the other side as well: best-effort readers get nothing again.
            time.sleep(0.5)
            for _ in range(times):
                writer.write(cls(body=list(body)))
            time.sleep(0.3)
        return {"heard": heard}


def main(peer):
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = getattr(peer, request.pop("op"))(**request)
        except Exception as error:  # noqa: BLE001 the test shows it
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(finite(answer)), flush=True)


if __name__ == "__main__":
    main(Peer())
