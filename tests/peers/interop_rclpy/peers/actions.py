"""Commands about actions."""

import messages
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse


def action_server(peer, name, type, how, feedback=(), result=None, cancels=True):
    """Serve goals: publish each item of `feedback`, then end as `how` says.

    `how`: `succeed`, `abort`, `raise`, or `cancel`, which waits for a cancellation; `reject` refuses goals.
    """
    cls = messages.load(type)
    goals = peer.entities["goals", name] = []

    def decide(goal):
        goals.append(messages.to_plain(goal))
        return GoalResponse.REJECT if how == "reject" else GoalResponse.ACCEPT

    async def execute(goal):
        for values in feedback:
            goal.publish_feedback(messages.build(cls.Feedback, values))
        if how == "raise":
            raise ValueError("on purpose")
        if how == "cancel":
            await peer.until(lambda: goal.is_cancel_requested)
            goal.canceled()
        else:
            getattr(goal, how)()
        return messages.build(cls.Result, result or {})

    peer.entities["action server", name] = ActionServer(
        peer.node,
        cls,
        name,
        execute,
        goal_callback=decide,
        cancel_callback=lambda _: CancelResponse.ACCEPT if cancels else CancelResponse.REJECT,
    )


def goals(peer, name):
    """Return the requested goals, oldest first."""
    return peer.entities["goals", name]


async def action_client(peer, name, type):
    client = peer.entities["action client", name] = ActionClient(peer.node, messages.load(type), name)
    await peer.until(client.server_is_ready)


async def send_goal(peer, name, key, goal):
    """Send a goal, which `key` names; return True if it was accepted."""
    client = peer.entities["action client", name]
    received = peer.entities["feedback", key] = []
    handle = await client.send_goal_async(
        messages.build(client._action_type.Goal, goal),
        lambda message: received.append(messages.to_plain(message.feedback)),
    )
    peer.entities["goal", key] = handle
    return handle.accepted


async def feedback(peer, key, count):
    received = peer.entities["feedback", key]
    await peer.until(lambda: len(received) >= count)
    return received


async def goal_status(peer, key, expected):
    await peer.until(lambda: peer.entities["goal", key].status == expected)


async def cancel(peer, key):
    response = await peer.entities["goal", key].cancel_goal_async()
    return {"code": response.return_code, "goals": len(response.goals_canceling)}


async def result(peer, key):
    answer = await peer.entities["goal", key].get_result_async()
    return {"status": answer.status, "result": messages.to_plain(answer.result)}
