/* The formulas of the observer studio, and the only place where it has any. Lengths in mm, times in ps,
   angles in rad. tests/docs/test_observer.py compares each with the package's own on random cases. */
"use strict";

const LIGHT_MM_PER_PS = 0.299792458;

const observerFormulas = {
  /** Unit direction [x, z] of a leg at elevation alpha out of the plane z = 0, towards +x. */
  direction(alpha) {
    return [Math.cos(alpha), Math.sin(alpha)];
  },

  /** Unit vector [x, z] from a point to the camera. */
  towards(point, camera) {
    const x = camera[0] - point[0], z = camera[1] - point[1], length = Math.hypot(x, z);
    return [x / length, z / length];
  },

  /** Foot of the perpendicular from the camera onto the line through the origin: `at`, the length along
      the line (mm), and `distance`, p (mm). */
  foot(camera, alpha) {
    const [x, z] = this.direction(alpha);
    return { at: camera[0] * x + camera[1] * z, distance: Math.abs(camera[1] * x - camera[0] * z) };
  },

  /** Viewing angle psi of a place on the line, from the foot's: negative before it, positive beyond. */
  viewingAngle(along, foot) {
    return Math.atan2(along - foot.at, foot.distance);
  },

  /** Length along the line of a viewing angle: the way back. */
  along(psi, foot) {
    return foot.at + foot.distance * Math.tan(psi);
  },

  /** Event time: the pulse passes the origin at 0. */
  eventTime(along, indexOut) {
    return indexOut * along / LIGHT_MM_PER_PS;
  },

  /** Place of the pulse on the line at an event time: the way back. */
  alongAtEvent(time, indexOut) {
    return time * LIGHT_MM_PER_PS / indexOut;
  },

  /** t_a = t + n_r |A - X| / c: when light from a point reaches the camera. */
  arrivalFromEvent(point, time, camera, indexBack) {
    return time + indexBack * Math.hypot(camera[0] - point[0], camera[1] - point[1]) / LIGHT_MM_PER_PS;
  },

  /** Half-angle law: t_a = t_f + (p / c) (n_r tan(pi/4 + psi/2) + (n_p - n_r) tan psi). */
  arrivalFromViewingAngle(psi, footTime, footDistance, indexOut, indexBack) {
    const bracket = indexBack * Math.tan(Math.PI / 4 + psi / 2) + (indexOut - indexBack) * Math.tan(psi);
    return footTime + footDistance / LIGHT_MM_PER_PS * bracket;
  },

  /** Viewing angle of the pulse that is seen at an arrival time: the way back, for n_r <= n_p. */
  viewingAngleFromArrival(arrival, footTime, footDistance, indexOut, indexBack) {
    const late = (arrival - footTime) * LIGHT_MM_PER_PS / footDistance;
    if (indexOut === indexBack) return 2 * Math.atan(late / indexOut) - Math.PI / 2;
    return Math.acos(indexBack / Math.hypot(late, indexOut)) - Math.atan2(indexOut, late);
  },

  /** v = c / (n_p - n_r d.u), mm/ps: length of path seen per time of arrival. */
  apparentSpeed(direction, towards, indexOut, indexBack) {
    const approach = direction[0] * towards[0] + direction[1] * towards[1];
    return LIGHT_MM_PER_PS / (indexOut - indexBack * approach);
  },

  /** The same by the viewing angle: d.u = -sin psi. */
  apparentSpeedAtAngle(psi, indexOut, indexBack) {
    return LIGHT_MM_PER_PS / (indexOut + indexBack * Math.sin(psi));
  },

  /** Viewing angle at which the pulse seems as fast as light in vacuum; null: it never does. */
  crossingAngle(indexOut, indexBack) {
    const sine = (1 - indexOut) / indexBack;
    return sine < -1 ? null : Math.asin(sine);
  },
};
