// Where the names of dots stand so that none covers another name or dot; those that find no room show under the pointer.

const WIDE = 6.8; // of a character at 12 px
const [ABOVE, BELOW] = [10, 3];
const DOT = 7;
const SIDES = [[9, 4, "start"], [-9, 4, "end"], [0, -10, "middle"], [0, 20, "middle"]];
const AHEAD = { start: 0, middle: 0.5, end: 1 };

const meet = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

// For each of `places` the attributes of its text, and whether it is `crowded` out of a chart of this size.
export function namesBeside(places, names, [width, height, start = 0]) {
  const taken = places.map(([x, y]) => [x - DOT, y - DOT, x + DOT, y + DOT]);
  return places.map(([x, y], at) => {
    const boxOf = ([dx, dy, anchor]) => {
      const left = x + dx - AHEAD[anchor] * WIDE * names[at].length;
      return [left, y + dy - ABOVE, left + WIDE * names[at].length, y + dy + BELOW];
    };
    const inside = (box) => box[0] >= start && box[1] >= 0 && box[2] <= width && box[3] <= height;
    const within = SIDES.filter((side) => inside(boxOf(side)));
    const free = within.find((side) => !taken.some((other, of) => of !== at && meet(boxOf(side), other)));
    if (free) taken.push(boxOf(free));
    const [dx, dy, anchor] = free ?? within[0] ?? SIDES[x > width / 2 ? 1 : 0];
    return { text: { x: dx, y: dy, "text-anchor": anchor }, crowded: !free };
  });
}
