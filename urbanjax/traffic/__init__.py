"""What logs of traffic say: divergence and similarity of driving, safety and flow (Eq. 30-33, Tables III-VIII)."""
