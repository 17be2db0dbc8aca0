// Stretches of a ray in a solid: where it enters and leaves; names are those of
// primitives/stretch.py.

struct End {
    float t;  // of size INFINITE where a stretch has no end, or is empty
    int part;
    float slope;  // how fast the ray crosses the surface
};

struct Stretch {
    End enter;
    End leave;
};

const Stretch NOWHERE = Stretch(End(INFINITE, 0, 0.0), End(-INFINITE, 0, 0.0));

// With parts that are counted from another number than 0.
End counted_from(int first, End one) {
    return End(one.t, first + one.part, one.slope);
}
