"""Peer on pyzeros, whose topics, services and tokens are correct. Arguments and lines as in raw.py."""

import asyncio
import sys

import pyzeros
import zenoh
from ros2_pyterfaces.cyclone.all_msgs import String
from ros2_pyterfaces.cyclone.all_srvs import SetBool

ROUTER, DOMAIN, SERVICE_HASH = sys.argv[1:4]
assert SetBool.hash_rihs01() == SERVICE_HASH


def say(*words: object) -> None:
    print(*words, flush=True)


async def publish(publisher: pyzeros.Pub) -> None:
    number = 0
    while True:
        number += 1
        publisher.publish(String(data=f"zeros {number}"))
        await asyncio.sleep(0.05)


async def listen(subscription: pyzeros.Sub) -> None:
    async for message in subscription.listen_reliable():
        say("heard", message.data, 0, "-")


async def serve(server: pyzeros.Server) -> None:
    async for responder in server.listen_reliable():
        say("asked", int(responder.request.data))
        responder.send(SetBool.Response(success=responder.request.data, message="zeros"))


async def main() -> None:
    publisher = pyzeros.Pub(String, "/from/peer")
    client = pyzeros.Client(SetBool, "/ours/set")
    tasks = [
        asyncio.ensure_future(publish(publisher)),
        asyncio.ensure_future(listen(pyzeros.Sub(String, "/to/peer"))),
        asyncio.ensure_future(serve(pyzeros.Server(SetBool, "/peer/set"))),
    ]
    say("ready", bytes(publisher.gid).hex())
    while line := await asyncio.to_thread(sys.stdin.readline):
        match line.split():
            case ["call", value]:
                response = await asyncio.wait_for(client.call_async(SetBool.Request(data=value == "1")), 10)
                say("answered", int(response.success), response.message)
    for task in tasks:
        task.cancel()


config = zenoh.Config()
config.insert_json5("connect/endpoints", f'["{ROUTER}"]')
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
config.insert_json5("scouting/multicast/enabled", "false")
with (
    zenoh.open(config) as session,
    pyzeros.auto_context(node="zeros", namespace="%", domain_id=int(DOMAIN), zenoh_session=session),
):
    asyncio.run(main())
