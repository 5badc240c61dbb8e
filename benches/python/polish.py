import sys,time; sys.path.insert(0,'benches/python'); sys.path.insert(0,'tests/support')
import numpy as np, patchtransfer as pt, robustness as R
from patchtransfer.interior.polish import polished, Polished, POWERS
from patchtransfer.sources.layout import rectangles
from patchtransfer.measure.bounds import proved_quality
from patchtransfer.interior.optimizer import SplineOptimizer
from patchtransfer.measure.similarity import similarity
n=int(sys.argv[1]); cont=sys.argv[2]
names=R.source_names(); fam=["bend","articulation","bump","swirl","stretch","smooth"]
rows=[]
for case in range(n):
    name=names[case%len(names)]; f=fam[(case//len(names))%len(fam)]
    try: strength,target,lm=R.feasible_target(case+5000,name,f)
    except Exception as e: continue
    src=R.source_named(name); plan=pt.TransferPlan(src,cont)
    t0=time.process_time()
    r=plan.transfer(target,lm,on_failure='return',refine='never')
    t1=time.process_time()
    if r.certificate.status!='certified': continue
    it=plan._interior; mp=r.multipatch; top=mp.topology
    space=None if r.rows is None else r.rows.space
    worth=lambda x: proved_quality(src.with_shared_points(x),[[]]*len(src),0.1,1e-3).min_scaled_jacobian.lower
    cert=lambda x: pt.certify(src.with_shared_points(x))
    x0=top.coordinates; w0=worth(x0)
    res=[]
    for ref in (None, rectangles(mp)):
        ta=time.process_time()
        opt=SplineOptimizer(src.topology, it.reference if ref is None else ref, excluded_corners=sorted(it._degenerate), null_space=None if space is None else space.columns)
        b=polished(opt,Polished(x0,r.certificate,w0,1),cert,worth,lambda:False)
        res.append((b.worth,b.power,time.process_time()-ta))
    m0=r.quality.scaled_jacobian.mean
    rows.append((w0,res[0][0],res[1][0],t1-t0,res[0][2],res[1][2]))
    print(case,name,f,'%.2f'%strength,'SJ %.3f -> src %.3f (p%d) rect %.3f (p%d)'%(w0,res[0][0],res[0][1],res[1][0],res[1][1]),'ms %.0f + %.0f %.0f'%(1e3*(t1-t0),1e3*res[0][2],1e3*res[1][2]),flush=True)
a=np.array(rows)
q=lambda x:np.round(np.quantile(x,[.25,.5,.75]),3)
print(len(a),'before',q(a[:,0]),'src',q(a[:,1]),'rect',q(a[:,2]),'best',q(a[:,1:3].max(1)),'time ratio',np.median((a[:,3]+a[:,4])/a[:,3]),np.median((a[:,3]+a[:,4]+a[:,5])/a[:,3]))
