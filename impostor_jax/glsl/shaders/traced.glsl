// What rays meet.

struct Met {
    Surface surface;
    int place;  // of the shape's first texel, -1 where nothing is met
    int kind;
};

// A shape's first texels: its anchor, what it is made of, and then its fields.
const int ANCHOR = 0, COLOR = 1, GLASSY = 2, FIELDS = 3;
