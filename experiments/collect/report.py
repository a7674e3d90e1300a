def write_sweep(folder):
    print("report", folder)
