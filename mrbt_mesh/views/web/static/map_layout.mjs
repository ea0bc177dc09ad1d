// Where things of the map go: functions of numbers alone. Lengths are pixels, unless they say otherwise.

// A spot's size, as a share of the distance to its neighbours; robots are smaller than places.
const PLACE_SHARE = 0.3, LEAST_PLACE = 5, MOST_PLACE = 16, ROBOT_SHARE = 0.85, LEAST_ROBOT = 7;
// Of all distances to a nearest neighbour, this share may be shorter than the one that counts.
const CROWDED = 0.1;
// Of a distance to neighbours, what robots that fan out may take up.
const FAN_SHARE = 0.5;
export const TEXT_HEIGHT = 14;
const LABEL_GAP = 2;
// Towards a corner of its spot a label is a little nearer.
const CORNER = 0.85;

// How the box `[left, top, right, bottom]` is shown whole in a pane: x of the pane = x * scale + shiftX.
export function fitted([left, top, right, bottom], width, height, margin) {
  const wide = Math.max(1e-6, right - left), high = Math.max(1e-6, bottom - top);
  const scale = Math.max(1e-6, Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high));
  return { scale, shiftX: (width - wide * scale) / 2 - left * scale, shiftY: (height - high * scale) / 2 - top * scale };
}

// The distance between neighbours among points `[x, y]`, in their unit; infinite for fewer than two.
export function neighbourDistance(points) {
  const nearest = points.map(([x, y], i) => Math.min(...points.map(([u, v], j) => {
    const distance = Math.hypot(x - u, y - v);
    return i === j || distance === 0 ? Infinity : distance;
  }))).filter(Number.isFinite).sort((a, b) => a - b);
  return nearest.length ? nearest[Math.floor(nearest.length * CROWDED)] : Infinity;
}

// The radii of places and robots where neighbours are so far apart.
export function sizes(distance) {
  const place = Math.max(LEAST_PLACE, Math.min(MOST_PLACE, distance * PLACE_SHARE));
  return { place, robot: Math.max(LEAST_ROBOT, place * ROBOT_SHARE) };
}

// Groups of `{x, y}` that would cover one another, in their order.
export function grouped(spots, radius) {
  const groups = [];
  for (const spot of spots) {
    const group = groups.find(({ x, y }) => Math.hypot(x - spot.x, y - spot.y) < 2 * radius);
    if (group) group.members.push(spot); else groups.push({ x: spot.x, y: spot.y, members: [spot] });
  }
  return groups;
}

// Where `count` spots go that are at one place: around it, so that none covers another; null where
// that takes more room than the half of the `distance` to the next place: then they are a stack.
export function fan(count, radius, distance) {
  if (count === 1) return [{ x: 0, y: 0 }];
  const around = Math.max(radius * 1.1, radius * 1.1 / Math.sin(Math.PI / count));
  if (around + radius > distance * FAN_SHARE) return null;
  return Array.from({ length: count }, (_, i) => {
    const angle = 2 * Math.PI * i / count - Math.PI / 2;
    return { x: around * Math.cos(angle), y: around * Math.sin(angle) };
  });
}

const overlap = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

// Which labels are shown and where, the first ones first: `{x, y, radius, width}` of each spot with its
// text -> `{x, y}`, the middle of the text, or null where it would cover a spot, another label or the edge.
// With `isNeeded` it may cover spots.
export function placed(labels, spots, width, height) {
  const taken = spots.map(({ x, y, radius, owner }) => ({ left: x - radius, right: x + radius, top: y - radius, bottom: y + radius, owner }));
  return labels.map((label) => {
    const { x, y, radius } = label, aside = radius + LABEL_GAP + label.width / 2, above = radius + LABEL_GAP + TEXT_HEIGHT / 2;
    const over = above * CORNER, beyond = aside * CORNER;
    const places = [[x, y + above], [x, y - above], [x + aside, y], [x - aside, y], [x + beyond, y - over], [x - beyond, y - over], [x + beyond, y + over], [x - beyond, y + over]];
    // A short one is within its spot.
    if (label.isInside && label.width <= 2 * radius - 2) places.unshift([x, y]);
    const boxes = places.map(([atX, atY]) => ({ x: atX, y: atY, left: atX - label.width / 2, right: atX + label.width / 2, top: atY - TEXT_HEIGHT / 2, bottom: atY + TEXT_HEIGHT / 2 }))
      .filter((box) => box.left >= 0 && box.top >= 0 && box.right <= width && box.bottom <= height);
    const isFree = (box, isOther) => !taken.some((each) => isOther(each) && overlap(each, box));
    const box = boxes.find((each) => isFree(each, ({ owner }) => owner !== label.owner))
      // What has to be seen may cover spots.
      ?? (label.isNeeded ? boxes.find((each) => isFree(each, ({ isText }) => isText)) : undefined);
    if (!box) return null;
    taken.push({ ...box, isText: true });
    return { x: box.x, y: box.y };
  });
}

// A route from one spot to another, which ends at the edge of its goal; null where they touch.
export function route(from, to, radius) {
  const long = Math.hypot(to.x - from.x, to.y - from.y);
  if (long <= radius) return null;
  const share = (long - radius) / long;
  return [from.x, from.y, from.x + (to.x - from.x) * share, from.y + (to.y - from.y) * share];
}
