// An arm's links in space: forward kinematics from what the server tells of them, and a parallel projection. Plain values.

function turned([x, y, z, w]) {
  return [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]];
}

const about = ([x, y, z], angle) => turned([x, y, z].map((v) => v * Math.sin(angle / 2)).concat(Math.cos(angle / 2)));
const times = (a, b) => a.map((row) => [0, 1, 2].map((k) => row[0] * b[0][k] + row[1] * b[1][k] + row[2] * b[2][k]));
const place = ({ at, turn }, p) => at.map((v, k) => v + turn[k][0] * p[0] + turn[k][1] * p[1] + turn[k][2] * p[2]);

// chain: origins [x y z qx qy qz qw] and axes [x y z] a link from the base outwards, capsules [link x y z x y z radius].
// Returns the links' origins, base first, the origins of those that turn, and the capsules in the base's frame.
export function links(chain, joints) {
  const base = { at: [0, 0, 0], turn: turned([0, 0, 0, 1]) }, frames = [], turning = [];
  let moving = 0;
  chain.origins.forEach((origin, k) => {
    const before = frames[k - 1] || base, frame = { at: place(before, origin), turn: times(before.turn, turned(origin.slice(3))) };
    if (chain.axes[k].some((v) => v)) {
      frame.turn = times(frame.turn, about(chain.axes[k], joints[moving++]));
      turning.push(frame.at);
    }
    frames.push(frame);
  });
  const capsules = chain.capsules.map(([link, ...ends]) => {
    const frame = link < 0 ? base : frames[link];
    return { start: place(frame, ends.slice(0, 3)), end: place(frame, ends.slice(3, 6)), radius: ends[6] };
  });
  return { origins: [base.at, ...frames.map((one) => one.at)], turning, capsules };
}

// Where a point is seen: to the right, upwards, and how far away.
export function seen([x, y, z], azimuth, height) {
  const c = Math.cos(azimuth), s = Math.sin(azimuth), across = c * x - s * y, deep = s * x + c * y;
  return [across, z * Math.cos(height) + deep * Math.sin(height), deep * Math.cos(height) - z * Math.sin(height)];
}
