"""Launch manifests: text → manifest (typed tree with positions) → plan (flat list of processes).

Loading is pure: nothing is started and no network is touched.
"""
