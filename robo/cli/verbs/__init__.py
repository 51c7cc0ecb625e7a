"""The verbs: what each is called, its options and examples. What they do stands beside this package."""
