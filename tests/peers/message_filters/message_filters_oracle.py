"""Server of results of message_filters, of Debian's python3-message-filters: one JSON request per line.

The package is that of ROS 1. Its classes differ from those of ROS 2 only in the handling of jumps of simulated time.
Run by the system's Python.
"""

import json
import sys

import message_filters
import rospy


class Header:
    pass


class Message:
    def __init__(self, stamp, name):
        self.header = Header()
        self.header.stamp = time(stamp)
        self.name = name


def time(nanoseconds):
    return rospy.Time(*divmod(nanoseconds, 10**9))


def sets(inputs, queue_size, slop_s, messages):
    """Return the sets that are passed after each message."""
    filters = [message_filters.SimpleFilter() for _ in range(inputs)]
    if slop_s is None:
        made = message_filters.TimeSynchronizer(filters, queue_size)
    else:
        made = message_filters.ApproximateTimeSynchronizer(filters, queue_size, slop_s)
    found = []
    made.registerCallback(lambda *several: found[-1].append([one.name for one in several]))
    for name, (index, stamp) in enumerate(messages):
        found.append([])
        filters[index].signalMessage(Message(stamp, name))
    return found


def cached(size, stamps, questions):
    """Return the answers of a cache of messages with rising stamps."""
    source = message_filters.SimpleFilter()
    cache = message_filters.Cache(source, size)
    for name, stamp in enumerate(stamps):
        source.signalMessage(Message(stamp, name))
    answers = []
    for start, end in questions:
        before, after = cache.getElemBeforeTime(time(end)), cache.getElemAfterTime(time(start))
        interval = [one.name for one in cache.getInterval(time(start), time(end))]
        answers.append([interval, before and before.name, after and after.name])
    last = cache.getLast()
    return [answers, last and last.name]


rospy.rostime.set_rostime_initialized(True)
for line in sys.stdin:
    what, *arguments = json.loads(line)
    sys.stdout.write(json.dumps((sets if what == "sets" else cached)(*arguments)) + "\n")
    sys.stdout.flush()
