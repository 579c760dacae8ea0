"""Loggers. Each call is a call site of its own for the filters."""
# ruff: noqa
# fmt: off

import rclpy.logging as L
from rclpy.logging import LoggingSeverity as S
root = L._root_logger
n = L.get_logger("a")

L.get_logger_level("")
root.get_effective_level()
n.info(5)  # text
n.info('x')
n.debug(5)
n.info('x',bogus=1)
n.info('x',throttle_time_source_type=5)
n.info('x',throttle_duration_sec=1,throttle_time_source_type='s')
n.info('x',throttle_duration_sec=1,throttle_time_source_type=None)  # text
n.log('x',15)
n.log('x',0)
n.set_level(15)
n.set_level('info')
L.set_logger_level('a',99)
L.get_logger('')
n.get_child('')
n.get_child('b').name
n.is_enabled_for(10)
n.is_enabled_for(20)
n.is_enabled_for(99)
n.info('%s %d')
n.info('x', name='other')
n.info()
n.info('a',once=False)
n.info('a',once=True)
n.info('a',skip_first=True)
n.info(None)
n.warn('w')
n.log('x', S.FATAL)
n.info('multi\nline')
n.info('')
n.fatal('x',throttle_duration_sec=0.0)
from rclpy.impl.implementation_singleton import rclpy_implementation as C
C.rclpy_logging_rcutils_log(20, "direct", "text 100% {x}", "function", "/a/file.py", 7)
C.rclpy_logging_rcutils_log(20, "direct", 5, "function", "/a/file.py", 7)  # text
C.rclpy_logging_rcutils_log(severity=20)  # text
C.rclpy_logging_set_logger_level("direct", 30)
(C.rclpy_logging_get_logger_level("direct"), C.rclpy_logging_get_logger_effective_level("direct.child"), C.rclpy_logging_logger_is_enabled_for("direct", 20))
C.rclpy_logging_rcutils_log(20, "direct", "not shown", "function", "/a/file.py", 7)
C.rclpy_logging_severity_level_from_string("warn")
type(C.rclpy_logging_get_logging_directory())
n.info(message='kw')
n.error('e',exc_info=True)
[n.info("x", once=True) for _ in range(3)]
[n.info("x", skip_first=True) for _ in range(3)]
[n.info("x", throttle_duration_sec=100) for _ in range(3)]
[n.info("x", throttle_duration_sec=0.0) for _ in range(3)]
[n.log("x", s) for s in (20, 30)]
[n.info("x", name=x) for x in "ab"]
[n.info("x", once=x) for x in (True, False)]
[n.info("x", throttle_duration_sec=x) for x in (1, 2)]
L.get_logging_severity_from_string("warn")
L.get_logging_severity_from_string("x")  # text
L.get_logger_level("a.b")
n.set_level(S.DEBUG)
L.get_logger_effective_level("a.b")
L.get_logger("a.b").is_enabled_for(S.DEBUG)
n.set_level(S.UNSET)
n.get_effective_level()
root.set_level(S.UNSET)
(root.get_effective_level(), L.get_logger_level(""), n.get_effective_level())
root.set_level(S.ERROR)
n.info("no")
L.clear_config()
(L.get_logger_level(""), n.get_effective_level())
