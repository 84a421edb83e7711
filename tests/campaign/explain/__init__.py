"""Whether `hbm explain` finds the causes of a residual, and how large they are."""
