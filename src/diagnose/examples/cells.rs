//! Temporary.
use hydroline_core::run::PerChannel;
use hydroline_diagnose::{read,Part};
use hydroline_inference::{fit::*,hyper::*,prior::PriorTable,recording::Recording};
use hydroline_rigs::{Dof,Rig};
fn main(){
  let args:Vec<String>=std::env::args().skip(1).collect();
  let rig=Rig::load(std::path::Path::new(&args[0])).unwrap();
  let given:Vec<usize>=args[1].split(',').filter(|s|!s.is_empty()).map(|n|Dof::ALL.into_iter().position(|d|d.name()==n).unwrap()).collect();
  let names:Vec<&str>=args[2].split(',').filter(|s|!s.is_empty()).collect();
  let share:f64=args[3].parse().unwrap();
  let runs:Vec<_>=args[4..].iter().map(|a|{let p:Part=a.parse().unwrap();read(p,&rig).unwrap().run}).collect();
  let recording=Recording::new(&runs,rig.tank.start_pose[5]);
  let mut dofs=recording.moving(&rig.tolerance.channels()); dofs.retain(|d|!given.contains(d));
  let mut p=Problem::beside(&runs,&rig,&dofs,&given,PriorTable::default()).unwrap();
  println!("noise {:?}",p.noises.channels.each().filter_map(|(c,n)|Some((c.name(),n.as_ref()?))).collect::<Vec<_>>());
  let mut at=p.least_squares(&[],&p.body.begin()).unwrap();
  let mut path=vec![at.clone()];
  for n in names {
    let c=p.body.candidates.iter().position(|c|c.name()==n).unwrap();
    let coarse=p.coarse(&p.left(&at.terms,&at.point));
    let g=coarse.predicted_gains(&at);
    let g=g.iter().find(|g|g.candidate==c&&g.instead.is_none()).unwrap();
    let (t,pt)=p.with(&at,c,&g.numbers);
    at=p.least_squares(&t,&pt).unwrap();
    path.push(at.clone());
  }
  let left=p.left(&at.terms,&at.point);
  p.noises.floor_sd=PerChannel::from_fn(|c|if left[c].is_finite(){share*left[c]}else{0.0});
  for f in &path {
    println!("{:?} {:?} {:?}",f.terms.iter().map(|t|p.body.candidates[*t].name()).collect::<Vec<_>>(),p.left(&f.terms,&f.point).by_name(),p.body.natural(&f.terms,&f.point).iter().map(|v|v.0 as f32).collect::<Vec<_>>());
    for c in [0,2] { for s in [3usize,5,6,7,8] {
      let cells=Cells::of([Cell{size:s,correlation:c};6]);
      let h=p.fit(&f.terms,&f.point,cells,Effort{forces_held:true,rounds:1,..Effort::DEFAULT});
      if let Some(h)=h { println!("  cell {c} {s}: held {:.1} left {:?}",h.ln_score,p.left(&h.terms,&h.point).by_name()); }
    }}
    for s in [0usize,4,8] {
      let cells=Cells::of([Cell{size:s,correlation:1};6]);
      if let Some(g)=p.fit(&f.terms,&f.point,cells,Effort{as_given:true,..Effort::DEFAULT}) {println!("   free from {s}: {:.1} {:?} left {:?} {:?}",g.ln_score,g.cells.misfit[dofs[0]],p.left(&g.terms,&g.point).by_name(),g.sizes);}
    }
  }
}
