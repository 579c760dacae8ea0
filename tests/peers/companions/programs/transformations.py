"""Results of tf_transformations, one line for each call. Run under the real one and under ours."""

# ruff: noqa: B023 (all is asked at once)

import json

import numpy as np
import tf_transformations as tf

rng = np.random.default_rng(7)


def told(value):
    if isinstance(value, tuple | list):
        return [told(one) for one in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def ask(question, *arguments, **named):
    try:
        print(json.dumps(told(question(*arguments, **named))))
    except Exception as error:
        print(json.dumps(type(error).__name__))


def numbers(count, much=3.0):
    return rng.uniform(-much, much, count).tolist()


def without_signs(make, take):
    """Return the result for a value whose signs do not matter."""
    return lambda *arguments, **named: make(*take(make(*arguments, **named)))


def projected(*arguments, pseudo=False, **named):
    taken = tf.projection_from_matrix(tf.projection_matrix(*arguments, pseudo=pseudo, **named), pseudo=pseudo)
    made = tf.projection_matrix(*taken)
    return made / made[3, 3]


ask(lambda: {name: tf._AXES2TUPLE[name] for name in sorted(tf._AXES2TUPLE)})
ask(lambda: [tf._TUPLE2AXES[one] for one in sorted(tf._TUPLE2AXES)])
ask(lambda: [tf.TRANSLATION_IDENTITY, tf.ROTATION_IDENTITY, tf.ZOOM_IDENTITY, tf.SHEAR_IDENTITY])
ask(tf.identity_matrix)
for axes in (*sorted(tf._AXES2TUPLE), (2, 1, 0, 1), "nothing", (1, 2, 3, 4)):
    for angles in ([*numbers(3)], [0.3, np.pi / 2, 0.5], [0.3, 0.0, 0.5], [1.0, np.pi, -1.0]):
        ask(tf.quaternion_from_euler, *angles, axes=axes)
        ask(tf.euler_matrix, *angles, axes=axes)
    ask(lambda: tf.euler_from_matrix(tf.euler_matrix(*numbers(3), axes), axes))
    ask(lambda: tf.euler_from_quaternion(tf.quaternion_from_euler(*numbers(3), axes=axes), axes))
for axes in ("sxyz", "rzyx", "szxz"):
    # What turns by right angles has numbers that are exact.
    ask(tf.euler_from_matrix, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], axes)
    ask(tf.euler_from_matrix, np.eye(4), axes)
for _ in range(2):
    one, two = (tf.random_quaternion(rng.random(3)) for _ in range(2))
    ask(lambda: one)
    for question in (tf.quaternion_matrix, tf.quaternion_conjugate, tf.quaternion_inverse):
        ask(question, one)
        ask(question, (3 * one).tolist())
    ask(lambda: tf.quaternion_from_matrix(tf.quaternion_matrix(two)))
    ask(tf.quaternion_multiply, one, two)
    ask(tf.quaternion_about_axis, numbers(1)[0], numbers(3))
    for fraction in (0.0, 0.3, 1.0, 1.5):
        ask(tf.quaternion_slerp, one, two, fraction)
        ask(tf.quaternion_slerp, one, -two, fraction, shortestpath=False)
        ask(tf.quaternion_slerp, one, two, fraction, 1)
    ask(tf.quaternion_slerp, one, one, 0.5)
    ask(tf.random_rotation_matrix, rng.random(3))
    matrix = tf.compose_matrix(scale=rng.uniform(0.5, 2, 3), shear=numbers(3), angles=numbers(3), translate=numbers(3))
    ask(lambda: matrix)
    ask(tf.decompose_matrix, matrix)
    ask(tf.decompose_matrix, matrix * (-1, 1, 1, 1))
    ask(tf.quaternion_from_matrix, matrix)
    ask(tf.translation_from_matrix, matrix)
    ask(tf.inverse_matrix, matrix)
    ask(tf.concatenate_matrices, matrix, tf.translation_matrix(numbers(3)), tf.scale_matrix(2))
    ask(tf.is_same_transform, matrix, matrix * 3)
    ask(tf.is_same_transform, matrix, np.eye(4))
    ask(tf.reflection_matrix, numbers(3), numbers(3))
    ask(without_signs(tf.reflection_matrix, tf.reflection_from_matrix), numbers(3), numbers(3))
    ask(tf.rotation_matrix, numbers(1)[0], numbers(3))
    ask(tf.rotation_matrix, numbers(1)[0], numbers(3), numbers(3))
    ask(without_signs(tf.rotation_matrix, tf.rotation_from_matrix), numbers(1)[0], numbers(3), numbers(3))
    ask(tf.scale_matrix, numbers(1)[0], numbers(3))
    ask(tf.scale_matrix, numbers(1)[0], numbers(3), numbers(3))
    ask(without_signs(tf.scale_matrix, tf.scale_from_matrix), 2.5, numbers(3))
    ask(without_signs(tf.scale_matrix, tf.scale_from_matrix), -1.5, numbers(3), numbers(3))
    normal = numbers(3)
    along = np.cross(normal, numbers(3)).tolist()
    ask(tf.shear_matrix, 0.4, along, numbers(3), normal)
    ask(without_signs(tf.shear_matrix, tf.shear_from_matrix), 0.4, along, numbers(3), normal)
    ask(tf.projection_matrix, numbers(3), numbers(3))
    for named in ({}, {"direction": numbers(3)}, {"perspective": numbers(3)}):
        ask(tf.projection_matrix, numbers(3), numbers(3), **named)
        ask(projected, numbers(3), numbers(3), **named)
    ask(tf.projection_matrix, numbers(3), numbers(3), None, numbers(3), True)
    ask(projected, numbers(3), numbers(3), perspective=numbers(3), pseudo=True)
    points = rng.uniform(-1, 1, (3, 5))
    for named in ({}, {"scaling": True}, {"usesvd": False}, {"scaling": True, "usesvd": False}):
        ask(tf.superimposition_matrix, points, rng.uniform(-1, 1, (3, 5)), **named)
        ask(tf.superimposition_matrix, points, -points, **{**named, "usesvd": True})
ask(tf.quaternion_matrix, [0, 0, 0, 0])
ask(tf.quaternion_matrix, [float("nan"), 0, 0, 1])
ask(tf.euler_from_quaternion, [float("nan")] * 4)
ask(tf.quaternion_from_matrix, np.zeros((4, 4)))
ask(tf.reflection_from_matrix, np.eye(4))
ask(tf.rotation_from_matrix, np.diag([2.0, 3.0, 4.0, 1.0]))
ask(tf.superimposition_matrix, np.eye(3), np.eye(4))
ask(tf.clip_matrix, -1, 2, -3, 4, 5, 6)
ask(tf.clip_matrix, -1, 2, -3, 4, 5, 6, True)
ask(tf.clip_matrix, 1, 1, -3, 4, 5, 6)
ask(tf.clip_matrix, -1, 2, -3, 4, -5, 6, True)
ask(tf.orthogonalization_matrix, (9.8, 12.0, 15.5), (87.2, 80.7, 69.7))
ask(tf.compose_matrix)
ask(tf.vector_norm, [])
ask(tf.vector_norm, numbers(3))
ask(tf.unit_vector, numbers(3))
block = rng.random((2, 3, 4))
for axis in (None, 0, -1):
    ask(tf.vector_norm, block, axis=axis)
    ask(tf.unit_vector, block, axis=axis)
out = np.zeros((2, 3))
ask(tf.vector_norm, block, axis=-1, out=out)
ask(lambda: out)
ask(tf.unit_vector, block, axis=1, out=block)
ask(lambda: block)
ask(lambda: np.shape(tf.random_vector(5)))
ask(tf.arcball_map_to_sphere, (3, 4), (1, 2), 10)
ask(tf.arcball_map_to_sphere, (30, 4), (1, 2), 10)
ask(tf.arcball_constrain_to_axis, (0, 0, 1), (0, 0, 1))
ask(tf.arcball_constrain_to_axis, (0, 1, 0), (0, 1, 0))
ask(tf.arcball_constrain_to_axis, (0.6, 0.0, -0.8), (0, 1, 0))
ask(tf.arcball_nearest_axis, (0.6, 0.0, 0.8), [(0, 1, 0), (1, 0, 0)])


def dragged(initial, constrain):
    ball = tf.Arcball(initial)
    ball.place([320, 320], 320)
    ball.setaxes([1, 1, 0], [-1, 1, 0])
    ball.setconstrain(constrain)
    ball.down([400, 200])
    ball.drag([200, 400])
    ball.drag([210, 380])
    ball.next()
    return ball.getconstrain(), ball.matrix()


for initial in (None, [0, 0, 0.6, 0.8], np.eye(4), [1, 2]):
    ask(dragged, initial, True)
    ask(dragged, initial, False)
