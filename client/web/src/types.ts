// The API's messages (proto/orbitune/v1), as proto3 JSON has them: 64-bit integers are strings, and a double that is
// NaN or infinite is a string, too. Only what the dashboard reads or writes.

export type Real = number | "NaN" | "Infinity" | "-Infinity";

export interface Keplerian {
  semi_major_axis_km?: number;
  eccentricity?: number;
  inclination_deg?: number;
  raan_deg?: number;
  argument_of_periapsis_deg?: number;
  true_anomaly_deg?: number;
  true_longitude_deg?: number;
}
export interface Equinoctial {
  p_km: number;
  ex: number;
  ey: number;
  hx: number;
  hy: number;
  true_longitude_deg: number;
}
export interface Cartesian {
  x_km: number;
  y_km: number;
  z_km: number;
  x_dot_km_s: number;
  y_dot_km_s: number;
  z_dot_km_s: number;
}
export interface OrbitState {
  keplerian?: Keplerian;
  equinoctial?: Equinoctial;
  cartesian?: Cartesian;
}
export interface Gains {
  k1: number;
  k2: number;
  k3: number;
  k4: number;
  k5: number;
}
export type GainKey = keyof Gains;
export const gainKeys: readonly GainKey[] = ["k1", "k2", "k3", "k4", "k5"];

export interface Hyperparameters {
  iterations?: number;
  step_size?: number;
  exploration_scale?: number;
  directions?: number;
  initial_gains?: Gains;
  exploration_std?: Gains;
  gain_floor?: number;
  seed?: string;
  algorithm?: string;
  max_episodes?: string;
  plateau_stop?: { iterations?: number; min_improvement?: number };
  ars_variants?: { top_directions?: number; step_schedule?: string; exploration_schedule?: string; log_gains?: boolean };
  cma_es?: { population?: number; initial_sigma?: number; restarts?: number; population_growth?: number };
  nelder_mead?: { initial_step?: number; restarts?: number };
}
export interface Scenario {
  name: string;
  display_name: string;
  description: string;
  gravitational_parameter_km3_s2: number;
  target: OrbitState;
  chaser: OrbitState;
  sampling_period_s: number;
  horizon_samples: number;
  fuel_weight: number;
  settling_distance_km: number;
  velocity_unit_m_s: number;
  acceleration_unit_m_s2: number;
  hyperparameters: Hyperparameters;
}

export type JobState = `JOB_STATE_${"QUEUED" | "RUNNING" | "PAUSED" | "SUCCEEDED" | "FAILED" | "CANCELLED"}`;

export interface Iteration {
  iteration: number;
  gains: Gains;
  cost?: Real;
  settling_samples: number;
  fuel_sum: Real;
  outcome: string;
  cost_std: Real;
  pairs_left_out: number;
  pairs_not_settled: number;
  episodes: string;
}
export interface EpisodeResult {
  outcome: string;
  outcome_message: string;
  end_time_s: number;
  cost?: Real;
  settling_samples: number;
  settling_time_s: number;
  fuel_sum: Real;
  delta_v_to_settling_m_s: Real;
  delta_v_horizon_m_s?: Real;
  peak_acceleration_m_s2: Real;
  initial_lyapunov: Real;
  domain_guarantee: string;
}
export interface Spread {
  mean: Real;
  min: Real;
  max: Real;
}
export interface EnsembleResult {
  initial_conditions: number;
  settled: number;
  objective?: Real;
  cost?: Spread;
  cost_reduction_percent?: Spread;
}
export interface GainsAssessment {
  iteration: number;
  gains: Gains;
  result: EpisodeResult;
  ensemble?: EnsembleResult | null;
}
export interface Reduction {
  cost_percent: Real;
  settling_time_percent: Real;
  fuel_sum_percent: Real;
  delta_v_percent: Real;
  peak_acceleration_percent: Real;
}
export interface JobReport {
  initial: GainsAssessment;
  final: GainsAssessment;
  best: GainsAssessment;
  final_reduction: Reduction;
  best_reduction: Reduction;
  warnings: { kind: string; message: string }[];
  episodes: string;
}
export interface Job {
  name: string;
  display_name: string;
  labels: Record<string, string>;
  scenario: string;
  scenario_definition?: Scenario | null;
  initial_condition?: OrbitState | null;
  initial_conditions?: OrbitState[];
  hyperparameters: Hyperparameters;
  warm_start?: string;
  state: JobState;
  create_time?: string | null;
  start_time?: string | null;
  end_time?: string | null;
  update_time?: string | null;
  completed_iterations: number;
  initial_iteration?: Iteration | null;
  latest_iteration?: Iteration | null;
  best_iteration?: Iteration | null;
  last_seq: string;
  report?: JobReport | null;
  error_message: string;
  etag: string;
  campaign?: string;
  provenance?: Provenance | null;
}
export interface Engine {
  first_iteration: number;
  version: string;
  simd_target: string;
  fused_multiply_add: boolean;
  libraries: string;
}
export interface Provenance {
  seed: string;
  scenario_digest: string;
  inputs_digest: string;
  digest: string;
  iterations: number;
  backfilled_iterations: number;
  engines: Engine[];
}
export interface Verification {
  verdict: string;
  completed_iterations: number;
  first_iteration: number;
  last_iteration: number;
  first_difference?: { iteration: number; stored?: Iteration | null; recomputed?: Iteration | null } | null;
  digest: string;
  recorded_digest: string;
  engine_differences: string[];
  conclusion: string;
}
export interface StateChange {
  state: JobState;
  time: string;
  message: string;
  report?: JobReport | null;
}
export interface JobEvent {
  seq: string;
  snapshot?: Job;
  iteration?: Iteration;
  state_change?: StateChange;
  gap?: { first_seq: string; last_seq: string };
}

export interface TrajectorySample {
  sample: number;
  time_s: number;
  chaser: Equinoctial;
  target: Equinoctial;
  control: { radial_m_s2: number; transverse_m_s2: number; normal_m_s2: number };
  lyapunov: number;
  distance_km: number;
}
export interface Episode {
  result: EpisodeResult;
  trajectory: TrajectorySample[];
}

export interface CampaignCount {
  members: number;
  jobs: number;
  ended: number;
  succeeded: number;
  running: number;
  completed_iterations: string;
}
export interface CampaignProgress {
  tuned: CampaignCount;
  held_out: CampaignCount;
  robust: CampaignCount;
}
export interface ReductionStatistics {
  average: Real;
  minimum: Real;
  maximum: Real;
  percentile_5: Real;
  percentile_25: Real;
  percentile_50: Real;
  percentile_75: Real;
  percentile_95: Real;
}
export interface GainsComparison {
  choice: string;
  over: string;
  flown: number;
  settled: number;
  not_settled: number;
  without_cost: number;
  compared: number;
  cost: ReductionStatistics;
  settling_time: ReductionStatistics;
  fuel_sum: ReductionStatistics;
  delta_v: ReductionStatistics;
}
export interface CampaignResults {
  mean_of: number;
  mean_gains?: Gains | null;
  robust_gains?: Gains | null;
  comparisons: GainsComparison[];
  best_on_held_out: string;
  conclusion: string;
  episodes: string;
}
export interface Campaign {
  name: string;
  display_name: string;
  scenario: string;
  scenario_definition?: Scenario | null;
  hyperparameters: Hyperparameters;
  state: string;
  create_time?: string | null;
  end_time?: string | null;
  progress?: CampaignProgress | null;
  last_seq: string;
  results?: CampaignResults | null;
  error_message: string;
  etag: string;
}
export interface MemberEpisode {
  choice: string;
  gains: Gains;
  outcome: string;
  cost?: Real;
  settling_samples?: number;
  settling_time_s?: number;
  fuel_sum?: Real;
  delta_v_to_settling_m_s?: Real;
  cost_reduction_percent?: Real;
}
export interface CampaignMember {
  role: string;
  number: number;
  initial_condition?: OrbitState | null;
  job: string;
  job_state: string;
  completed_iterations: number;
  error_message: string;
  episodes: MemberEpisode[];
}
export interface CampaignEvent {
  seq: string;
  snapshot?: Campaign;
  member_ended?: CampaignMember;
  state_change?: { state: string; time: string; message: string; results?: CampaignResults | null };
  progress?: CampaignProgress;
}

export interface Certificate {
  gains_positive: boolean;
  domain_guaranteed: boolean;
  lyapunov_decreasing: boolean;
  settled: boolean;
}
export interface Flight {
  outcome: string;
  outcome_message: string;
  cost?: Real;
  settling_samples: number;
  settling_time_s: number;
  fuel_sum: Real;
  delta_v_m_s: Real;
  peak_acceleration_m_s2: Real;
  certificate?: Certificate;
}
export interface GainAnswer {
  source: string;
  gain_set: string;
  kind: string;
  gains: Gains;
  distance?: Real;
  flight: Flight;
}
export interface GainQueryAnswer {
  answers: GainAnswer[];
  settled: boolean;
  position?: {
    library_size: string;
    located: string;
    nearest_distance?: Real;
    centre_distance?: Real;
    typical_distance?: Real;
    extrapolated: boolean;
  };
  candidates: number;
  candidates_settled: number;
  refinement?: { episodes: string; elapsed_s: number; improved: boolean } | null;
  message: string;
}
