use diffusion::*;
use material::*;
fn main() {
    for n in [[64, 64, 20], [130, 53, 37], [256, 256, 20]] {
        let g = Grid::new(n, [1.0; 3]).unwrap();
        let k: Vec<f64> = (0..g.len())
            .map(|i| {
                let x = (i % n[0]) as f64;
                let y = (i / n[0] % n[1]) as f64;
                let z = (i / n[0] / n[1]) as f64;
                let f = 0.5 + 0.5 * ((x * 0.23 + 0.3 * z).sin() * (y * 0.17).cos());
                if (x - 0.35 * n[0] as f64).hypot(y - 0.4 * n[1] as f64) < 4.0 {
                    0.02
                } else {
                    0.15 * 10f64.powf(f)
                }
            })
            .collect();
        let m = Medium::new(g, k, vec![0.005; g.len()]).unwrap();
        let mut o = Optics::from_eta(1.3);
        o.boundary = BoundaryConvention::Wang2008;
        let maps = (0..16)
            .map(|r| {
                (0..g.face_len())
                    .map(|i| {
                        let x = i % n[0] * 4 / n[0];
                        let y = i / n[0] * 4 / n[1];
                        if y * 4 + x == r { 1.0 } else { 0.0 }
                    })
                    .collect()
            })
            .collect();
        let l = Illuminations::new(&g, Face::Front, maps).unwrap();
        for _ in 0..3 {
            let t = std::time::Instant::now();
            let mut s = CpuSolver::<f32>::new();
            let mut f = Forward::new(m.clone(), &o, &mut s).unwrap();
            let t1 = t.elapsed().as_secs_f64();
            let b = f.right_hand_side(&l);
            let t2 = t.elapsed().as_secs_f64();
            let mut x = Batch::zeros(g.len(), 16);
            let rep = f.solve_raw(&b, &mut x, 1e-6).unwrap();
            let e = t.elapsed().as_secs_f64();
            println!(
                "{n:?} setup {t1:.3} rhs {t2:.3} total {e:.3} {rep:?} {:.1} M/s",
                g.len() as f64 * 16.0 / e / 1e6
            );
        }
    }
}
