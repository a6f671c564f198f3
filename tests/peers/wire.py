"""Every UDP datagram over IPv4 that arrives at a network device, whoever it is for: one line each on stderr."""

import socket
import sys

wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0800))
wire.bind((sys.argv[1], 0))
print("listening", file=sys.stderr, flush=True)
while True:
    frame, (_, _, kind, _, _) = wire.recvfrom(1 << 16)
    if kind != socket.PACKET_OUTGOING and frame[23] == socket.IPPROTO_UDP:
        sender, receiver = socket.inet_ntoa(frame[26:30]), socket.inet_ntoa(frame[30:34])
        print(f"{sender} to {receiver}, {len(frame)} bytes", file=sys.stderr, flush=True)
