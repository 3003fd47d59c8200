// A learned skill read by a program that knows nothing of this project: means and covariances are enough.
//
//     opcua-skill skills export SKILL --format json -o skill.json
//     node skill_path.js skill.json 1000 > path.csv
//
// prints phase, time and position (SI units), and the tool's orientation if it was learned, at even phases of the path.
// Equations: docs/reference/learning/model.md. No packages are needed.
'use strict';
const fs = require('fs');

/** Return E[outputs | clock]: every column but the clock's, mixed by the activations of the components. */
function regress(means, covariances, clock) {
  // The prior is tied, w_k = sqrt(S_11,k) / sum, and cancels against the density's own factor.
  const exponents = means.map((mean, k) => (0.5 * (clock - mean[0]) ** 2) / covariances[k][0][0]);
  const nearest = Math.min(...exponents);
  const weights = exponents.map((exponent) => Math.exp(nearest - exponent));
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  return means[0].slice(1).map((_, i) => {
    const line = (k) => means[k][i + 1] + (covariances[k][i + 1][0] / covariances[k][0][0]) * (clock - means[k][0]);
    return weights.reduce((sum, weight, k) => sum + (weight / total) * line(k), 0);
  });
}

/** Return rows of phase, time, position and perhaps a unit quaternion x y z w. */
function path(skill, points) {
  const overPath = skill.clock === 'path';
  return Array.from({ length: points }, (_, i) => {
    const phase = i / (points - 1);
    const clock = overPath ? phase : phase * skill.duration;
    const outputs = regress(skill.means, skill.covariances, clock);
    const time = overPath ? outputs.shift() : clock;
    const position = outputs.slice(0, skill.dimension);
    const quaternion = outputs.slice(skill.dimension);
    const length = Math.hypot(...quaternion);
    return [phase, time, ...position, ...quaternion.map((part) => part / length)];
  });
}

const [file, points] = process.argv.slice(2);
if (!(Number(points) >= 2)) {
  console.error('usage: node skill_path.js skill.json POINTS');
  process.exit(2);
}
const skill = JSON.parse(fs.readFileSync(file, 'utf8'));
const rows = path(skill, Number(points));
const names = ['phase', 't_s', 'x_m', 'y_m', ...(skill.dimension === 3 ? ['z_m'] : []), 'qx', 'qy', 'qz', 'qw'];
console.log(names.slice(0, rows[0].length).join(','));
for (const row of rows) console.log(row.join(','));
