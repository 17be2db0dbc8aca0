// Where the ray of a pixel meets a triangle, an open sheet.
//
// The corners are seen around the ray one way, each as wide as its direction may be
// rounded, so that no ray slips through between two triangles of a mesh. Formulas and
// names are those of primitives/triangle.py. Fields: corners, in columns.

const float WIDTH = 8.0 * EPS;

struct Sight {
    float distance;
    vec3 across;
    float reach;
    float along;
};

Sight sight(vec3 o, vec3 d, vec3 corner) {
    vec3 offset = corner - o;
    float distance = length(offset);
    vec3 v = distance > 0.0 ? offset / distance : vec3(0.0);
    float along = dot(v, d);
    vec3 across = v - d * along;
    return Sight(distance, across, length(across) + WIDTH, along * distance);
}

// 1 where the corners turn around the ray this way, to rounding; 2 the other way; or 3.
int ways(float turn, Sight v, Sight w) {
    float slack = WIDTH * (v.reach + w.reach);
    return (turn >= -slack ? 1 : 0) + (turn <= slack ? 2 : 0);
}

int first_of(vec3 v) {
    return v.x >= max(v.y, v.z) ? 0 : v.y >= v.z ? 1 : 2;
}

vec3 unit_normal() {
    vec3 x = corners[1] - corners[0], y = corners[2] - corners[1];
    vec3 z = corners[0] - corners[2];
    float size = sqrt(max(max(dot(x, x), dot(y, y)), dot(z, z)));
    x /= size, y /= size, z /= size;
    int longest = first_of(vec3(dot(x, x), dot(y, y), dot(z, z)));
    return normalize(longest == 0 ? cross(y, z) : longest == 1 ? cross(z, x) : cross(x, y));
}

Surface intersect(vec3 o, vec3 direction) {
    float speed = length(direction);
    vec3 d = direction / speed;
    Sight a = sight(o, d, corners[0]), b = sight(o, d, corners[1]);
    Sight c = sight(o, d, corners[2]);
    // Of the edge opposite to each corner.
    vec3 turns = vec3(
        dot(d, cross(b.across, c.across)),
        dot(d, cross(c.across, a.across)),
        dot(d, cross(a.across, b.across))
    );
    vec3 low = min(min(a.across, b.across), c.across);
    vec3 high = max(max(a.across, b.across), c.across);
    bool met = (ways(turns.x, b, c) & ways(turns.y, c, a) & ways(turns.z, a, b)) != 0
        && all(lessThanEqual(low, vec3(WIDTH)))
        && all(greaterThanEqual(high, vec3(-WIDTH)));
    if (!met) return MISS;
    int nearest = first_of(abs(turns) / vec3(a.distance, b.distance, c.distance));
    vec3 n = unit_normal();
    float n_d = dot(n, direction);
    float t = dot(n, corners[nearest] - o) / (n_d == 0.0 ? 1.0 : n_d);
    // Of a ray in the plane, to rounding, that may be anything.
    vec3 along = vec3(a.along, b.along, c.along);
    vec3 spare = WIDTH * vec3(a.distance, b.distance, c.distance);
    vec3 near = (along - spare) / speed, far = (along + spare) / speed;
    t = max(t, min(min(near.x, near.y), near.z));
    t = min(t, max(max(far.x, far.y), far.z));
    if (!(t > 0.0)) return MISS;
    return Surface(t, facing(n, direction), 0);
}
