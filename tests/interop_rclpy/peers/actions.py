"""Commands about actions."""

import messages
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse


def action_server(peer, name, type, how, feedback=(), result=None, cancels=True):
    """Serve goals: publish each item of `feedback`, then end as `how` says.

    `how`: `succeed`, `abort`, `raise`, or `cancel`, which waits for a cancellation; `reject` refuses goals.
    """
    cls = messages.load(type)
    goals = peer.things["goals", name] = []

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

    peer.things["action server", name] = ActionServer(
        peer.node,
        cls,
        name,
        execute,
        goal_callback=decide,
        cancel_callback=lambda _: CancelResponse.ACCEPT if cancels else CancelResponse.REJECT,
    )


def goals(peer, name):
    """Return the requested goals, oldest first."""
    return peer.things["goals", name]


async def action_client(peer, name, type):
    made = peer.things["action client", name] = ActionClient(peer.node, messages.load(type), name)
    await peer.until(made.server_is_ready)


async def send_goal(peer, name, key, goal):
    """Send a goal, which `key` names; return True if it was accepted."""
    made = peer.things["action client", name]
    heard = peer.things["feedback", key] = []
    handle = await made.send_goal_async(
        messages.build(made._action_type.Goal, goal), lambda one: heard.append(messages.to_plain(one.feedback))
    )
    peer.things["goal", key] = handle
    return handle.accepted


async def feedback(peer, key, count):
    heard = peer.things["feedback", key]
    await peer.until(lambda: len(heard) >= count)
    return heard


async def goal_status(peer, key, expected):
    await peer.until(lambda: peer.things["goal", key].status == expected)


async def cancel(peer, key):
    response = await peer.things["goal", key].cancel_goal_async()
    return {"code": response.return_code, "goals": len(response.goals_canceling)}


async def result(peer, key):
    answer = await peer.things["goal", key].get_result_async()
    return {"status": answer.status, "result": messages.to_plain(answer.result)}
