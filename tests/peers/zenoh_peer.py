"""The same peer on the wire of rmw_zenoh_cpp: Eclipse Zenoh's Python package, messages by Cyclone DDS's CDR, hashes of types and
names of the graph by zenoh-ros2-sdk. Nothing here knows the Rust code.

It is also the router, at tcp/127.0.0.1:ROUTER_PORT, unless there is one already (ROUTER=no: it looks for none).
"""

import os
import re
import time
import types

os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # the SDK would fetch definitions; here it is given them

import zenoh
import zenoh.ext
import zenoh.handlers
from cyclonedds.idl import make_idl_struct
from zenoh_ros2_sdk import keyexpr, utils
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.entity import EndpointEntity, EntityKind, NodeEntity
from zenoh_ros2_sdk.qos import QosDurability, QosProfile, QosReliability
from zenoh_ros2_sdk.utils import compute_service_type_hash, compute_type_hash_from_msg, ros2_to_dds_type

import peer
import ros_types

QOS = {
    "reliable": (QosReliability.RELIABLE, QosDurability.VOLATILE),
    "best_effort": (QosReliability.BEST_EFFORT, QosDurability.VOLATILE),
    "latched": (QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL),
    "full": (QosReliability.RELIABLE, QosDurability.VOLATILE),
}
# Sequences of one at most. Bounds do not show in CDR, so ros_types leaves them out; a hash has them, and the SDK can't read them.
BOUNDED = {"floating_point_range", "integer_range"}


def _parsed(text, parse=utils._parse_msg_definition):
    fields = parse(text)
    for field in fields:
        if field["name"] in BOUNDED:
            field.update(is_bounded=True, array_size=1)
    return fields


utils._parse_msg_definition = _parsed


def _qualified(text, package):
    """A definition whose types all have their package."""
    lines = []
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if not line or re.match(r"^\S+\s+\w+\s*=", line):
            continue
        kind, name = line.split()[:2]
        base, bracket, suffix = kind.partition("[")
        base = base if base in ros_types.PRIMITIVES or "/" in base else f"{package}/{base}"
        lines.append(f"{base}{bracket}{suffix} {name}")
    return "\n".join(lines)


def _full(name, kind="msg"):
    return name if f"/{kind}/" in name else name.replace("/", f"/{kind}/", 1)


DEFINITIONS = {_full(name): _qualified(text, name.split("/")[0]) for name, text in ros_types.TEXTS.items()}


def type_hash(name):
    """Of `package/msg/Type` or `package/srv/Type`."""
    if "/srv/" not in name:
        return compute_type_hash_from_msg(_full(name), DEFINITIONS[_full(name)], DEFINITIONS)
    package = name.split("/")[0]
    request, response = (_qualified(t, package) for t in ros_types.SERVICES[name.replace("/srv/", "/")])
    return compute_service_type_hash(name, request, response, DEFINITIONS)


def to_cdr(message):
    return message.serialize(use_version_2=False)


class Reader:
    """As a DataReader has it, as far as peer.py needs one."""

    def __init__(self, node, entity, cls, key, latched, depth):
        self.node, self.cls = node, cls
        # A queue of Zenoh's own: a callback would wait for the interpreter's lock, 5 ms while `ping` looks without sleeping.
        ring = zenoh.handlers.RingChannel(depth)
        if latched:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            self.subscriber = zenoh.ext.declare_advanced_subscriber(node.session, key, ring, history=history)
        else:
            self.subscriber = node.session.declare_subscriber(key, ring)
        self.wanted = ("MP", entity.name, entity.dds_type_name, entity.type_hash)

    def take(self, N=1):
        messages = []
        while len(messages) < N and (sample := self.subscriber.try_recv()) is not None:
            extra = Attachment.from_bytes(sample.attachment.to_bytes())
            message = self.cls.deserialize(sample.payload.to_bytes())
            message.sample_info = types.SimpleNamespace(source_timestamp=extra.timestamp_ns)
            messages.append(message)
        return messages

    def get_matched_publications(self):
        return self.node.there(self.wanted)


class Writer:
    """As a DataWriter has it."""

    def __init__(self, node, entity, key, latched, depth):
        self.node, self.sent, self.gid = node, 0, os.urandom(16)
        if latched:
            self.publisher = zenoh.ext.declare_advanced_publisher(
                node.session, key, cache=zenoh.ext.CacheConfig(depth), publisher_detection=True)
        else:
            # a test's own message is never dropped
            block = zenoh.CongestionControl.BLOCK
            self.publisher = node.session.declare_publisher(key, express=True, congestion_control=block)
        self.wanted = ("MS", entity.name, entity.dds_type_name, entity.type_hash)

    def write(self, message):
        self.sent += 1
        self.publisher.put(to_cdr(message), attachment=Attachment(self.sent, time.time_ns(), self.gid).to_bytes())

    def get_matched_subscriptions(self):
        return self.node.there(self.wanted)


class ZenohPeer(peer.Peer):
    def __init__(self):
        self.domain = int(os.environ["ROS_DOMAIN_ID"])
        self.readers, self.writers, self.clients, self.received = {}, {}, {}, {}
        self.names, self.calls = {}, 0
        port = os.environ["ROUTER_PORT"]
        self.router = None
        if os.environ.get("ROUTER") != "no":
            self.router = self._open("router", listen=[f"tcp/127.0.0.1:{port}"])
        self.session = self._open("peer", listen=["tcp/127.0.0.1:0"], connect=[f"tcp/127.0.0.1:{port}"])
        self.node = NodeEntity(self.domain, str(self.session.zid()), 0, "peer")
        self.tokens = [self.session.liveliness().declare_token(keyexpr.node_liveliness_keyexpr(self.node))]
        self.graph = self.session.liveliness().declare_subscriber(
            f"{keyexpr.ADMIN_SPACE}/{self.domain}/**", self._note_token, history=True)

    def _open(self, mode, listen, connect=()):
        config = zenoh.Config()
        for key, value in {"mode": mode, "listen/endpoints": listen, "connect/endpoints": list(connect),
                           "scouting/multicast/enabled": False, "timestamping/enabled": True}.items():
            config.insert_json5(key, peer.json.dumps(value))
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if mode != "router":
                raise
            return None  # there is one

    def _note_token(self, sample):
        token = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self.names[token] = token.split("/")
        else:
            self.names.pop(token, None)

    def there(self, wanted):
        kind, name, dds_type, hash_ = wanted
        mangled = name.replace("/", "%")
        return [t for t, p in list(self.names.items())
                if p[5] == kind and p[9:12] == [mangled, dds_type, hash_] and p[2] != self.node.session_id]

    def _entity(self, kind, name, type, qos="reliable", depth=10, hash=None):
        reliability, durability = QOS[qos]
        profile = QosProfile(reliability=reliability, durability=durability, history_depth=depth)
        full = _full(type, "srv" if kind == EntityKind.CLIENT else "msg")
        entity = EndpointEntity(self.node, len(self.tokens), kind, name, ros2_to_dds_type(full),
                                hash or type_hash(full), profile.encode())
        self.tokens.append(self.session.liveliness().declare_token(keyexpr.endpoint_liveliness_keyexpr(entity)))
        return entity, keyexpr.topic_keyexpr(self.domain, name, entity.dds_type_name, entity.type_hash)

    def subscribe(self, topic, type, qos="reliable", depth=2000):
        entity, key = self._entity(EntityKind.SUBSCRIPTION, topic, type, qos, depth)
        self.readers[topic] = Reader(self, entity, ros_types.message(type), key, qos == "latched", depth)
        self.received[topic] = []
        return {}

    def advertise(self, topic, type, qos="reliable", depth=2000, hash=None):
        entity, key = self._entity(EntityKind.PUBLISHER, topic, type, qos, depth, hash)
        writer = Writer(self, entity, key, qos == "latched", depth)
        self.writers[topic] = (writer, ros_types.message(type))
        return {}

    def call(self, service, type, request=None, timeout=10.0, quiet=False):
        """Calls a service as rmw_zenoh_cpp does."""
        name = type.replace("/srv/", "/")
        if service not in self.clients:
            package, short = name.split("/")
            ask, reply = (make_idl_struct(f"{short}{part}", f"{package}.{short}{part}", ros_types._fields(text, package))
                          for part, text in zip(("_Request", "_Response"), ros_types.SERVICES[name]))
            self.clients[service] = (ask, reply, *self._entity(EntityKind.CLIENT, service, type))
        ask, reply, entity, key = self.clients[service]
        end = time.monotonic() + timeout
        while not self.there(("SS", entity.name, entity.dds_type_name, entity.type_hash)):
            if time.monotonic() > end:
                return {"error": f"no server of {service}"}
            time.sleep(0.01)
        self.calls += 1
        replies = self.session.get(
            key, payload=to_cdr(ros_types.from_dict(ask, request or {})), target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE, timeout=max(end - time.monotonic(), 0.1),
            attachment=Attachment(self.calls, time.time_ns(), b"\x2a" * 16).to_bytes())
        for answer in replies:
            if answer.ok is not None:
                extra = Attachment.from_bytes(answer.ok.attachment.to_bytes())
                if (extra.sequence_id, extra.gid) != (self.calls, b"\x2a" * 16):
                    return {"error": f"an answer to call {extra.sequence_id}"}
                return {"response": ros_types.to_dict(reply.deserialize(answer.ok.payload.to_bytes()))}
        return {"response": None} if quiet else {"error": f"no answer from {service}"}

    def serve(self, service, type, response):
        """Answers every call of a service with the same response."""
        name = type.replace("/srv/", "/")
        package, short = name.split("/")
        reply = make_idl_struct(f"{short}_Response", f"{package}.{short}_Response",
                                ros_types._fields(ros_types.SERVICES[name][1], package))
        key = keyexpr.topic_keyexpr(self.domain, service, ros2_to_dds_type(type), type_hash(type))
        body = to_cdr(ros_types.from_dict(reply, response))
        self.clients[key] = self.session.declare_queryable(
            key, lambda query: query.reply(key, body, attachment=query.attachment.to_bytes()), complete=True)
        return {}

    def hashes(self, types):
        return {"hashes": [type_hash(t) for t in types]}

    def graph_tokens(self):
        """The parts of every token of other sessions."""
        return {"tokens": [p for p in list(self.names.values()) if p[2] != self.node.session_id]}

    def endpoints(self):
        """As peer.py says it: services as the two topics that DDS has for them."""
        time.sleep(1.0)
        found = []
        for parts in list(self.names.values()):
            if parts[2] == self.node.session_id or parts[5] not in ("MP", "MS", "SS"):
                continue
            name, dds_type, qos = parts[9].replace("%", "/"), parts[10], QosProfile.decode(parts[12])
            same = {"reliable": qos.reliability == QosReliability.RELIABLE,
                    "latched": qos.durability == QosDurability.TRANSIENT_LOCAL}
            if parts[5] == "SS":
                stem = dds_type.rstrip("_")
                found += [{"side": "subscription", "topic": f"rq{name}Request", "type": f"{stem}_Request_"} | same,
                          {"side": "publisher", "topic": f"rr{name}Reply", "type": f"{stem}_Response_"} | same]
            else:
                side = "publisher" if parts[5] == "MP" else "subscription"
                found.append({"side": side, "topic": f"rt{name}", "type": dds_type} | same)
        return {"endpoints": found}

    def participants(self, wanted, timeout=20.0):
        end = time.monotonic() + timeout
        others = set()
        while time.monotonic() < end:
            others = {p[2] for p in list(self.names.values())} - {self.node.session_id}
            if len(others) == wanted:
                break
            time.sleep(0.05)
        return {"others": len(others)}


if __name__ == "__main__":
    peer.main(ZenohPeer())
