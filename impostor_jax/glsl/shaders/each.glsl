// All shapes of one kind, whose `intersect` and fields stand before; the names are
// replaced by the kind's own.

uniform ivec2 listed;  // first texel, and how many shapes there are

void meet(vec3 o, vec3 d, inout Met met) {
    for (int k = 0; k < listed.y; k++) {
        int place = listed.x + k * (FIELDS + TEXELS);
        take(place + FIELDS);
        Surface seen = intersect(o, d);
        if (seen.t < met.surface.t) met = Met(seen, place, KIND);
    }
}

bool blocks(vec3 o, vec3 d, float reach) {
    for (int k = 0; k < listed.y; k++) {
        take(listed.x + k * (FIELDS + TEXELS) + FIELDS);
        if (intersect(o, d).t < reach) return true;
    }
    return false;
}
