"""PPO of TorchRL on the native vector environment.

PYTHONPATH=. python examples/trainers/ppo_torchrl.py
"""

import excitation as task
import torch
from excitation import Excitation, Learned, command, network, updates
from gymnasium.vector import AutoresetMode
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE


def train(steps, seed):
    """The policy after `steps` decisions."""
    torch.manual_seed(seed)
    vector = Excitation(AutoresetMode.DISABLED, seed)  # TorchRL resets what has ended; NEXT_STEP is refused
    env = GymWrapper(vector)
    mean = network(vector, 3, 0.01)
    scaled = torch.nn.Sequential(mean, AddStateIndependentNormalScale(3, scale_mapping="exp"))
    torch.nn.init.constant_(scaled[1].state_independent_scale, task.LOG_STD)
    actor = ProbabilisticActor(
        TensorDictModule(scaled, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(network(vector, 1, 1.0), in_keys=["observation"])
    advantages = GAE(gamma=task.GAMMA, lmbda=task.GAE_LAMBDA, value_network=critic)
    loss = ClipPPOLoss(
        actor,
        critic,
        clip_epsilon=task.CLIP,
        entropy_bonus=False,
        critic_coeff=0.5,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    optimizer = torch.optim.Adam(loss.parameters(), task.LEARNING_RATE, eps=1e-5)
    rollout = task.ENVS * task.ROLLOUT
    collector = Collector(
        env,
        actor,
        frames_per_batch=rollout,
        total_frames=updates(steps) * rollout,
        auto_register_policy_transforms=False,  # they mark where memories begin again, of which there are none
    )
    for data in collector:
        with torch.no_grad():
            advantages(data)
        flat = data.reshape(-1)
        for _ in range(task.EPOCHS):
            for batch in torch.randperm(rollout).chunk(task.MINIBATCHES):
                terms = loss(flat[batch])
                optimizer.zero_grad()
                (terms["loss_objective"] + terms["loss_critic"]).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
    collector.shutdown()  # closes the environments
    return Learned.of(mean)


if __name__ == "__main__":
    command(train, "TorchRL")
