// x = inverse · b on the coarsest level; the dot is x · b.
// Twin: SolveDirectly in diffusion/src/cpu/multigrid.rs.

@group(1) @binding(0) var<storage, read> inverse: array<f32>;
@group(1) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(64)
fn solve_directly(at: Invocation) {
    let size = level.cells.x * level.cells.y * level.cells.z;
    let quad = at.id.x % level.quads;
    let cell = at.id.x / level.quads;
    var dot = vec4(0.0);
    if cell < size {
        var sum = vec4(0.0);
        for (var j = 0u; j < size; j++) {
            sum += inverse[cell * size + j] * b[j * level.quads + quad];
        }
        x[at.id.x] = sum;
        dot = sum * b[at.id.x];
    }
    add_up(at, dot, level.quads);
}
